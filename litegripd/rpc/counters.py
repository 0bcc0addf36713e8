"""What is counted of one connection, by whoever does what is counted: service or transport."""

from dataclasses import dataclass


@dataclass(slots=True, eq=False)
class Counters:
    """One client's figures since it connected.

    `requests` counts the lines that were served, `refused` those of them that were refused,
    `dropped` the samples of its subscriptions that it was not sent. `worst_latency_s` is the
    longest time from a line having come to its answer being queued, of requests that wait for no
    motion; None before the first.
    """

    requests: int = 0
    refused: int = 0
    bytes_in: int = 0
    bytes_out: int = 0
    dropped: int = 0
    worst_latency_s: float | None = None

    def note_latency(self, latency_s: float) -> None:
        """Keep the worst."""
        if self.worst_latency_s is None or latency_s > self.worst_latency_s:
            self.worst_latency_s = latency_s
