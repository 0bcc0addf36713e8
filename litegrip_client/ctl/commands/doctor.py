"""The command that looks at everything a gripper needs, also where no daemon runs."""

from __future__ import annotations

import shlex
from collections.abc import Mapping

from litegrip_client.ctl.render_doctor import findings_text
from litegrip_client.ctl.run import NOT_OK, OK, Command, Fill, Run
from litegrip_client.doctor.findings import as_data, examine
from litegrip_client.doctor.gather import gather
from litegrip_client.doctor.table import CHECKS


def doctor(run: Run) -> int:
    """Show what was found; the exit code tells whether there is an error."""
    options = run.options
    if options.ssh_host is not None:
        return run.refuse(
            "doctor looks at the machine that it runs on, not at another one",
            f"run it there: ssh {shlex.quote(options.ssh_host)} litegripctl doctor",
        )
    facts = gather(options.channel, options.socket, channel_chosen=options.channel_chosen)
    findings = examine(facts, CHECKS)
    data = as_data(facts.channel if facts.is_channel_known else None, findings)
    run.output.result(data, findings_text(findings))
    return OK if data["ok"] else NOT_OK


COMMANDS: Mapping[str, Command] = {"doctor": doctor}
OPTIONS: Mapping[str, Fill] = {}
