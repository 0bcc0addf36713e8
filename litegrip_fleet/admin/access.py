"""The router's rules, made from a table of users and gateways: default deny, both ways.

zenoh's rules know no templates: each user and each gateway gets rules of its own, which name its
certificate (its common name). A rule must include the whole key that is asked for, so a wildcard is
let through only where all that it could mean is allowed.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from litegrip_fleet.wire.keys import CLASSES, PREFIX, Place

ROLES = tuple(CLASSES)
"""From the lowest; each may what those before it may."""


def rules(users: Mapping[str, str], gateways: Mapping[str, Sequence[Place]]) -> dict[str, Any]:
    """Return zenoh's `access_control`: the roles of the users, and the grippers of the gateways."""
    subjects = [{"id": name, "cert_common_names": [name]} for name in sorted({*users, *gateways})]
    user_rules = {name: _user_rules(name, role) for name, role in sorted(users.items())}
    gateway_rules = {name: _gateway_rules(name, own) for name, own in sorted(gateways.items())}
    both = [*user_rules.items(), *gateway_rules.items()]
    return {
        "enabled": True,
        "default_permission": "deny",
        "subjects": subjects,
        "rules": [rule for _name, own in both for rule in own],
        "policies": [
            {"subjects": [name], "rules": [rule["id"] for rule in own]} for name, own in both
        ],
    }


def _user_rules(user: str, role: str) -> list[dict[str, Any]]:
    """Return what a user may: ask and stop in his own name, hear the answers, see who is there."""
    own = [
        f"{PREFIX}/*/*/rpc/{user}/*/{CLASSES[lower]}" for lower in ROLES[: ROLES.index(role) + 1]
    ]
    asks = [*own, f"{PREFIX}/*/*/stop/{user}", f"{PREFIX}/*/*/hello"]
    told = [f"{PREFIX}/*/*/to/{user}/*"]
    return [
        _rule(f"user {user} asks", ["query"], "ingress", asks),
        _rule(f"user {user} is answered", ["reply"], "egress", asks),
        _rule(f"user {user} listens", ["declare_subscriber"], "ingress", told),
        _rule(f"user {user} hears", ["put"], "egress", told),
        _rule(f"user {user} looks", ["liveliness_query"], "ingress", [f"{PREFIX}/**"]),
        _rule(f"user {user} sees", ["liveliness_token"], "egress", [f"{PREFIX}/*/*/alive"]),
    ]


def _gateway_rules(gateway: str, places: Sequence[Place]) -> list[dict[str, Any]]:
    """Return what a gateway may: be asked for its own grippers, answer, and say that they live."""
    kinds = ("rpc/**", "stop/*", "hello")
    asked = [f"{place.key}/{kind}" for place in places for kind in kinds]
    # What is asked of a whole site has a wildcard for the gripper.
    asked_of_all = [f"{PREFIX}/*/*/stop/*", f"{PREFIX}/*/*/hello"]
    alive = [place.alive for place in places]
    told = [f"{place.key}/to/**" for place in places]
    return [
        _rule(f"gateway {gateway} offers", ["declare_queryable"], "ingress", asked),
        _rule(f"gateway {gateway} is asked", ["query"], "egress", [*asked, *asked_of_all]),
        _rule(f"gateway {gateway} answers", ["reply"], "ingress", asked),
        _rule(f"gateway {gateway} lives", ["liveliness_token"], "ingress", alive),
        # So that `litegripd-fleet check` can see there whether its own grippers are.
        _rule(f"gateway {gateway} looks", ["liveliness_query"], "ingress", alive),
        _rule(f"gateway {gateway} sees", ["liveliness_token"], "egress", alive),
        _rule(f"gateway {gateway} sends", ["put"], "ingress", told),
        _rule(f"gateway {gateway} is listened to", ["declare_subscriber"], "egress", told),
    ]


def _rule(identity: str, messages: Sequence[str], flow: str, keys: Sequence[str]) -> dict[str, Any]:
    return {
        "id": identity,
        "permission": "allow",
        "flows": [flow],
        "messages": list(messages),
        "key_exprs": list(keys),
    }
