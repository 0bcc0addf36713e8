"""Whether a router's access control lets somebody do more than the table of users says.

The rules that `litegripd-fleet router` makes need no such check. A stock zenohd reads its own
file, in which somebody may have written more.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import zenoh

_FLOWS = ("ingress", "egress")
_ANYBODY = None
"""Whom a subject without a certificate's name means."""


class UnreadableError(ValueError):
    """A file that zenoh does not read as its configuration; the message says why."""


@dataclass(frozen=True, slots=True)
class _Grant:
    """What one line of a rule allows: to whom, which messages, which way, below which key."""

    rule: str
    name: str | None
    message: str
    flow: str
    key: str

    @property
    def act(self) -> tuple[str | None, str, str]:
        """All but the key."""
        return self.name, self.message, self.flow


def access_control_in(file: str) -> dict[str, Any]:
    """Return the access control of a zenoh configuration; raises `UnreadableError`."""
    try:
        found: dict[str, Any] = json.loads(zenoh.Config.from_file(file).get_json("access_control"))
    except zenoh.ZError as error:
        raise UnreadableError(f"{file}: {str(error).partition(' at /')[0]}") from error
    return found


def wider(given: Mapping[str, Any], made: Mapping[str, Any]) -> list[str]:
    """Return what `given` allows and `made` does not, a sentence each; empty if nothing.

    Both are zenoh's `access_control`. A rule that denies takes nothing away from what is found
    here, and what narrows a subject further (an interface, a user name) does not either.
    """
    if not given.get("enabled"):
        return ["access control is off: everybody may do everything"]
    found = []
    if given.get("default_permission", "deny") != "deny":
        found.append("default_permission is not deny: what no rule names is allowed to everybody")
    allowed: dict[tuple[str | None, str, str], list[zenoh.KeyExpr]] = {}
    for grant in _grants(made):
        allowed.setdefault(grant.act, []).append(zenoh.KeyExpr(grant.key))
    for grant in _grants(given):
        key = zenoh.KeyExpr(grant.key)
        if not any(own.includes(key) for own in allowed.get(grant.act, ())):
            name = "everybody" if grant.name is _ANYBODY else grant.name
            found.append(
                f"rule {grant.rule!r} allows {name}: {grant.message} ({grant.flow}) of {grant.key}"
            )
    return found


def _grants(control: Mapping[str, Any]) -> Iterator[_Grant]:
    """Give all that the rules allow, each for the names of the subjects that have them."""
    names = {
        subject["id"]: subject.get("cert_common_names") or [_ANYBODY]
        for subject in control.get("subjects") or ()
    }
    rules = {rule["id"]: rule for rule in control.get("rules") or ()}
    for policy in control.get("policies") or ():
        for identity in policy["rules"]:
            rule = rules[identity]
            if rule["permission"] != "allow":
                continue
            for name in (name for subject in policy["subjects"] for name in names[subject]):
                for message in rule["messages"]:
                    for flow in rule.get("flows") or _FLOWS:
                        for key in rule["key_exprs"]:
                            yield _Grant(identity, name, message, flow, key)
