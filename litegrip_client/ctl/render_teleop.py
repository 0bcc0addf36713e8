"""How `litegripctl` shows teleoperation: a status in, text out; prints nothing itself."""

from __future__ import annotations

from litegrip_client.ctl.render import Data, figure, plain

_LABEL_WIDTH = 17
_COUNTS = (
    "torque_trips",
    "rejected",
    "out_of_order",
    "other_leaders",
    "late",
    "dropped",
    "send_failed",
)


def line(data: Data) -> str:
    """Show how it goes in one line."""
    whose, own = _owners(data)
    parts = [
        f"{data.get('mode')!s} {data.get('phase')!s:<9}",
        f"{whose}{_percent(data):>6}",
        f"{figure(data.get('position_mm'), '7.2f', 'mm'):>10}",
        f"{own}{figure(data.get('torque_nm'), '+.2f', 'N·m'):>10}",
        *_felt(data),
        f"{figure(data.get('loop_hz'), '.0f', 'Hz'):>6}",
        f"frames {data.get('frames')}",
    ]
    return plain("  ".join(parts + _troubles(data)))


def ended(data: Data, *, holding: bool = False) -> str:
    """Show in one line how it ended; with `holding` a command ended it and the jaws hold."""
    if data.get("mode") is None:
        return "no teleoperation so far"
    by = f" by {data['fault']}" if data.get("fault") else ""
    parts = [f"{data['mode']} ended{by} after {data.get('frames')} frames", *_counts(data)]
    return plain(", ".join(parts)) + ("; the jaws hold" if holding and not by else "")


def status(data: Data) -> str:
    """Show a status in aligned lines."""
    if data.get("mode") is None:
        return "no teleoperation so far"
    verdict = "runs" if data.get("active") else "does not run"
    whose, own = _owners(data)
    rows = [
        ("teleop", f"{data.get('mode')}, {verdict} ({data.get('phase')})"),
        ("link", f"{data.get('link')} {data.get('link_state') or 'closed'}{_where(data)}"),
        ("topic", f"{data.get('topic')}"),
        (
            f"{whose}opening",
            f"{figure(data.get('position_mm'), '.2f', 'mm')}, {_percent(data)} open",
        ),
        (f"{whose}force", figure(data.get("force_n"), "+.1f", "N")),
        (f"{own}torque", figure(data.get("torque_nm"), "+.2f", "N·m")),
        ("frames", f"{data.get('frames')}, the last {_age(data)} ago"),
        ("loop", figure(data.get("loop_hz"), ".0f", "Hz")),
    ]
    if data.get("mode") == "master" and data.get("active"):
        rows.append(("followers", _followers(data)))
    rows += [("felt", text) for text in _felt(data)]
    if data.get("active") and data.get("link_protected") is False:
        rows.append(("open to", "whoever reaches the link"))
    troubles = _troubles(data)
    if troubles:
        rows.append(("note", ", ".join(troubles)))
    if data.get("fault"):
        rows.append(("ended by" if not data.get("active") else "fault", str(data["fault"])))
    return "\n".join(f"{label:<{_LABEL_WIDTH}} {plain(text)}" for label, text in rows)


def _owners(data: Data) -> tuple[str, str]:
    """Name the owners of what is in frames and of what is measured here, where they differ."""
    return ("leader's ", "own ") if data.get("mode") == "slave" else ("", "")


def _followers(data: Data) -> str:
    """Show how many follow, as far as a leader can know: each is heard only with reflection."""
    count = data.get("followers")
    if count is not None:
        return f"{count} heard"
    if data.get("matching") is None:
        return "not known: they are not heard"
    return "at least one" if data["matching"] else "none"


def _where(data: Data) -> str:
    """Name the other end where this one goes to it, else the port at which it listens."""
    host, port = data.get("host"), data.get("port")
    if port is None:
        return ""
    return f", port {port}" if host is None else f", {_address(host, port)}"


def _leader(data: Data) -> str:
    host, port = data.get("host"), data.get("port")
    if host is None:
        return "a leader" if port is None else f"a leader at port {port}"
    return _address(host, port)


def _address(host: object, port: object) -> str:
    """Put the port behind a host; several hosts may have ports of their own."""
    text = str(host)
    return f"[{text}]:{port}" if text.count(":") > 1 and "," not in text else f"{text}:{port}"


def _felt(data: Data) -> list[str]:
    """Show force reflection: the slave's last report, or the master's present push."""
    force_n = data.get("reflected_n")
    if force_n is None:
        return []
    trip = figure(data.get("round_trip_ms"), ".0f", "ms")
    on_time = f" ({trip} round)" if data.get("mode") == "master" else ""
    return [f"reflects {figure(force_n, '+.1f', 'N')}{on_time}"]


def _troubles(data: Data) -> list[str]:
    """Name what is not as it should be."""
    found = []
    if data.get("active") and data.get("mode") == "slave" and not data.get("frames"):
        found.append(f"nothing heard from {_leader(data)} yet")
    if data.get("stale"):
        found.append(f"STALE {_age(data)}")
    if data.get("over_torque"):
        found.append("RELEASED")
    if data.get("force_limited"):
        found.append("force limited")
    if data.get("followers") == 0:
        found.append("nobody tells a force")
    if data.get("link_state") == "failed":
        found.append(f"link failed: {data.get('link_error')}")
    if data.get("mode") == "master" and data.get("matching") is False:
        found.append("nobody follows")
    return found + _counts(data)


def _counts(data: Data) -> list[str]:
    return [f"{name} {data[name]}" for name in _COUNTS if data.get(name)]


def _percent(data: Data) -> str:
    openness = data.get("openness")
    return f"{100.0 * openness:.1f} %" if isinstance(openness, int | float) else "--"


def _age(data: Data) -> str:
    return figure(data.get("last_frame_age_ms"), ".0f", "ms")
