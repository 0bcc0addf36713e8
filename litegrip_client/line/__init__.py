"""Lines of JSON: which answer belongs to which request, subscriptions, a connection for threads.

Nothing here knows what a method of the daemon does.
"""
