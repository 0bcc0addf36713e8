"""What measuring the travel prints, as the vendor's SDK does; nothing else of the client prints."""

import sys

from litegrip_client.calibration import CalibrationData
from litegrip_client.results import MoveProgress

_REPORTS_PER_LINE = 10
"""Reports come at 20 Hz: two lines a second."""


class ProbePrinter:
    """Prints each new phase, and now and then how far it is."""

    def __init__(self) -> None:
        self._phase = ""
        self._reports = 0

    def progress(self, report: MoveProgress) -> None:
        """Print a line for some of the reports."""
        if report.phase != self._phase:
            self._phase, self._reports = report.phase, 0
        if self._reports % _REPORTS_PER_LINE == 0:
            total = f"/{report.total_steps}" if report.total_steps else ""  # mostly nobody knows
            _print(
                f"[{report.phase}] {report.i}{total} cmd={report.cmd_rad:+.4f} "
                f"pos={report.pos_rad:+.4f} tau={report.torque_nm:+.3f}"
            )
        self._reports += 1

    def end(self, data: CalibrationData, path: str | None) -> None:
        """Print what was measured, and where the daemon saved it."""
        saved = "not saved" if path is None else f"saved by the daemon to {path}"
        _print(
            f"closed {data.zero_position_rad:+.4f} rad, open {data.max_position_rad:+.4f} rad, "
            f"travel {data.travel_range_rad:.4f} rad, {data.rad_to_mm:.2f} mm/rad; {saved}"
        )


def _print(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()
