"""Commands on the world of a simulated gripper: an object, a hand, faults, heat."""

from __future__ import annotations

from argparse import ArgumentTypeError

from litegrip_client.ctl.parser import LateParser, in_unit, not_negative, number, positive
from litegrip_client.ctl.run import Commands, Run
from litegrip_client.values.errors import CommandError
from litegrip_client.values.figures import figure

_SIM = """\
Change the world of a simulated gripper: what is between its jaws, a hand that
pushes them, faults of its motor. Without an action it is shown as it really is.
A gripper on a real bus has no such world.
"""


def sim_options(parser: LateParser) -> None:
    """Add the arguments of `sim`."""
    parser.description = _SIM
    add = parser.add_subparsers(dest="action", metavar="ACTION", parser_class=LateParser).add_parser
    add("show", help="show the world as it really is")
    add("object", help="put an object between the jaws, or take it away", fill=_object_options)
    add("push", help="push the jaws by a hand, until the next push", fill=_push_options)
    add("hold", help="hold the jaws fast, until 'push' or 'reset'")
    add(
        "fault",
        help="let the motor report a fault, lose its power, or be weak",
        fill=_fault_options,
    )
    add("heat", help="let the motor's coil have a temperature", fill=_heat_options)
    add("reset", help="take object, hand, heat and faults away")


def _object_options(parser: LateParser) -> None:
    parser.description = "Put an object between the jaws, in place of any other, or take it away."
    parser.epilog = (
        "examples:\n  litegripctl sim object 40 --stiffness 10\n  litegripctl sim object none"
    )
    parser.add_argument("width", type=_width, metavar="WIDTH", help="in mm, or none")
    parser.add_argument(
        "--stiffness", type=positive, metavar="NM_RAD", help="250 is rigid (default), 10 is foam"
    )
    parser.add_argument(
        "--slip",
        type=in_unit(not_negative, "mm/s"),
        metavar="MM_S",
        help="how fast it gives way under pressure",
    )


def _push_options(parser: LateParser) -> None:
    parser.description = "Push the jaws by a hand, until the next push."
    parser.add_argument(
        "torque",
        type=in_unit(number, "N·m"),
        metavar="NM",
        help="positive closes, negative opens, 0 lets go",
    )


def _fault_options(parser: LateParser) -> None:
    parser.description = (
        "Let the motor latch a fault, lose its power (silent) or most torque (weak),\n"
        "or have none of these any more (none)."
    )
    parser.add_argument("name", metavar="NAME", help="overload, coil_hot, silent, ..., none")


def _heat_options(parser: LateParser) -> None:
    parser.description = "Let the motor's coil have a temperature; it then cools as ever."
    parser.add_argument("coil", type=in_unit(number, "°C"), metavar="C", help="in °C")


def _width(text: str) -> float | None:
    if text == "none":
        return None
    width_mm = in_unit(number, "mm")(text)
    if not width_mm > 0.0:
        raise ArgumentTypeError(f"{text!r} is no width: say millimetres above 0, or none")
    return width_mm


_PARAMETERS = {
    "object": {"width": "width_mm", "stiffness": "stiffness_nm_rad", "slip": "slip_mm_s"},
    "push": {"torque": "torque_nm"},
    "fault": {"name": "name"},
    "heat": {"coil": "coil_c"},
}
"""By action: the parameter that each option is."""


def sim(run: Run) -> int:
    """Change the world, and show it."""
    if not run.connection.call("hello")["simulated"]:
        raise CommandError(
            "this gripper is not simulated: its world is the real one",
            reason="not_simulated",
            data={"hint": "start one that is: litegripd sim0 --simulate"},
        )
    action = run.options.action or "show"
    params = {
        parameter: value
        for option, parameter in _PARAMETERS.get(action, {}).items()
        if (value := getattr(run.options, option)) is not None
    }
    data = run.connection.call("sim.get" if action == "show" else f"sim.{action}", params)
    what, item = "none", data["object"]
    if item is not None:
        slips = f", slips at {item['slip_mm_s']:g} mm/s" if item["slip_mm_s"] else ""
        what = f"{item['width_mm']:g} mm, {item['stiffness_nm_rad']:g} N·m/rad{slips}"
    hand, push_nm = "none", data["push_nm"]
    if data["held"]:
        hand = "holds the jaws fast"
    elif push_nm:
        hand = f"pushes {'closed' if push_nm > 0 else 'open'} with {abs(push_nm):g} N·m"
    power = "on" if data["powered"] else "off"
    power += f", {data['fault']}" if data.get("fault") else ""
    share = data.get("made_share", 1.0)
    torque = f", makes {share:.0%} of its torque" if share < 1.0 else ""
    lines = (
        f"object   {what}",
        f"opening  {figure(data['opening_mm'], '.1f', 'mm')}",
        f"hand     {hand}",
        f"motor    power {power}{torque}, coil {figure(data['coil_c'], '.0f', '°C')}",
    )
    return run.done(data, "\n".join(lines))


COMMANDS: Commands = {
    "sim": (sim, sim_options),
}
