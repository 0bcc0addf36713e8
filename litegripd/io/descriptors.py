"""How many clients this process has descriptors for; those that stops need are kept free."""

import resource

from litegripd.io.stop_listener import MAX_STOP_CONNECTIONS

OWN = 64  # for sockets, files, timers, links and child processes
PER_CLIENT = 2  # its connection, and what tells that its process has ended
LEAST_CLIENTS = 16


class TooFewDescriptorsError(OSError):
    """The process may not open enough files; the message says how many it needs."""


def clients_within_limit(wanted: int) -> int:
    """Raise the limit of open files where that is needed and allowed; return how many clients fit.

    Returns `wanted` at most. Raises `TooFewDescriptorsError` where there is hardly room for any.
    """
    reserved = OWN + MAX_STOP_CONNECTIONS
    enough = reserved + PER_CLIENT * wanted
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    limit = _larger(soft, _smaller(hard, enough))
    if limit != soft:
        resource.setrlimit(resource.RLIMIT_NOFILE, (limit, hard))
    clients = (_smaller(limit, enough) - reserved) // PER_CLIENT
    if clients < LEAST_CLIENTS:
        raise TooFewDescriptorsError(
            f"this process may open {hard} files, and needs {reserved + PER_CLIENT * LEAST_CLIENTS}"
            f" at least ({enough} for {wanted} clients), some of them for stops: raise the limit"
            " (LimitNOFILE= of the unit, or ulimit -n)"
        )
    return clients


def _larger(one: int, other: int) -> int:
    return resource.RLIM_INFINITY if resource.RLIM_INFINITY in (one, other) else max(one, other)


def _smaller(one: int, other: int) -> int:
    finite = [limit for limit in (one, other) if limit != resource.RLIM_INFINITY]
    return min(finite)
