"""What a gripper's client does, written once, as coroutines that know no event loop.

`litegrip_client.aio` runs them on asyncio, and has their classes as its own. The client for
threads is made from them by docs/generate.py; it runs the same coroutines over a connection that
blocks instead of suspending them (see `threads.blocking`). So nothing here may use asyncio or
threads; what has to wait is awaited of the session and of its connection (`session.Wire`).

A wait may end by an interrupt (KeyboardInterrupt, or a cancelled task) or any other exception:
code that must restore something then stands under `except BaseException`.
"""
