"""All commands of litegripctl: their parsers, their actions, and a command line for each."""

from collections.abc import Iterator, Mapping

from litegrip_client.ctl.commands import COMMANDS
from litegrip_client.ctl.parser import Parser, whole_parser

ACTIONS = {
    "calibration": ["show", "templates", "load", "save", "manual", "rescale"],
    "config": ["get", "set"],
    "lease": ["show", "take"],
    "trajectories": ["list", "get", "put", "delete", "keep", "export"],
    "teleop": ["master", "slave", "status", "stop"],
    "sim": ["show", "object", "push", "hold", "fault", "heat", "reset"],
}

LINES: tuple[str, ...] = (
    "state",
    "watch --count 2",
    "disable",
    "clear-fault",
    "enable",
    "open --speed 100",
    "close --speed 100",
    "cancel 1",
    "grasp --force 10",
    "release",
    "move 50%",
    "force 12",
    "slack",
    "hold",
    "teleop slave --fake-leader --detach",
    "teleop status",
    "teleop stop",
    "teleop master --link udp --host 127.0.0.1 --port 9 --detach",
    "stop --level relax --why x",
    "clear",
    "clients",
    "lease show",
    "lease take because",
    "jobs",
    "job 1",
    "events --kind bus",
    "enable",
    "open --speed 140",
    "enable --retries 3",
    "zero --yes",
    "calibration show",
    "calibration templates",
    "calibration load normal",
    "calibration save",
    "calibration manual",
    "calibration rescale",
    "config get",
    "config set force_n=11",
    "register PMAX",
    "record taught --seconds 0.2",
    "play taught",
    "trajectories list",
    "trajectories get taught --overwrite",
    "trajectories put taught --as copied",
    "trajectories keep another",
    "trajectories delete copied",
    "trajectories export taught",
    "dump",
    "plot taught",
    "health",
    "metrics",
    "restart --hold",
    "info",
    "discover",
    "doctor",
    "install-units --root /nowhere --uninstall",
    "sim object 1 --stiffness 100 --slip 1",
    "sim push -0.1",
    "sim hold",
    "sim heat 30",
    "sim fault overload",
    "sim show",
    "sim reset",
    "completion bash",
    "fleet --config no-such-fleet.toml",
)
"""A command line for each command, and for each action of one; a daemon can be led through them."""

WITHOUT_DAEMON = ("doctor", "completion", "fleet", "install-units")


def every_parser() -> Iterator[Parser]:
    """Give the whole parser, and those of all commands and of their actions."""
    open_ones: list[Parser] = [whole_parser(COMMANDS)]
    while open_ones:
        parser = open_ones.pop()
        yield parser
        for action in parser.arguments():
            if isinstance(action.choices, Mapping):
                for inner in action.choices.values():
                    inner.become()
                    open_ones.append(inner)


def every_command() -> set[str]:
    """Give the names of all commands, with their actions where they have some."""
    (commands,) = (
        one.choices for one in whole_parser(COMMANDS).arguments() if one.dest == "command"
    )
    assert commands is not None
    return {f"{name} {action}".strip() for name in commands for action in ACTIONS.get(name) or [""]}
