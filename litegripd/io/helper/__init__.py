"""The helper process and the other processes of the daemon, and the files that they write."""
