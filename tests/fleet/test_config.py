"""The configuration of a fleet: what it says is what is meant, and anything else is refused."""

from pathlib import Path

import pytest

from litegrip_fleet.admin.access import rules
from litegrip_fleet.admin.config import FleetConfigError, load
from litegrip_fleet.admin.main import main
from litegrip_fleet.wire.keys import BadNameError, Place, caller_in, place_in, stopper_in

TLS = 'ca = "/a"\ncertificate = "/b"\nkey = "/c"\n'
NETWORK = f"[network]\n{TLS}"
GATEWAY = NETWORK + '[gateway]\nsite = "lab"\ngrippers = { left = "can0" }\n'


def config(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "fleet.toml"
    file.write_text(text, encoding="utf-8")
    return file


def test_all_three_parts(tmp_path: Path) -> None:
    file = config(
        tmp_path,
        NETWORK + 'connect = ["tls/r:7447"]\n'
        '[gateway]\nsite = "lab"\ngrippers = { left = "can0", right = "can1" }\n'
        '[portal]\nuser = "op1"\ngrippers = ["lab.left"]\nttl_s = 0.5\n'
        '[router]\nlisten = ["tls/0.0.0.0:7447"]\nusers = { op1 = "operator" }\n'
        'gateways = { robot1 = ["lab.left", "lab.right"] }\n',
    )
    found = load(str(file))
    left, right = Place("lab", "left"), Place("lab", "right")
    assert found.network.tls is not None
    assert not found.insecure
    assert found.gateway is not None
    assert found.gateway.places == {left: "can0", right: "can1"}
    assert found.portal is not None
    assert (found.portal.grippers, found.portal.role, found.portal.ttl_s) == (
        [left],
        "operator",
        0.5,
    )
    assert found.router is not None
    assert found.router.gateways == {"robot1": [left, right]}


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "insecure = true"),
        ("[network]\n", "insecure = true"),
        ('[network]\nca = "/a"\n', "insecure = true"),
        (f"[network]\n{TLS}insecure = true\n", "choose one"),
        ("[network]\ninsecure = 1\n", "true or false"),
        (f"{NETWORK}[porter]\n", "unknown"),
        (f"{NETWORK}conect = []\n", "unknown"),
        (f"{NETWORK}[portal]\nusr = 'op1'\n", "user is missing; is it meant by 'usr', which"),
        (f"{NETWORK}[gateway]\n", "site is missing"),
        (f'{NETWORK}[gateway]\nsite = "a/b"\ngrippers = {{}}\n', "1 to 32 letters"),
        (f'{NETWORK}[gateway]\nsite = "lab"\ngrippers = {{}}\n', "is empty"),
        (f'{NETWORK}[gateway]\nsite = "lab"\ngrippers = {{"*" = "can0"}}\n', "1 to 32 letters"),
        (f'{NETWORK}[gateway]\nsite = "lab"\ngrippers = {{a = "../x"}}\n', "cannot be a channel"),
        (f"{GATEWAY}stop_when_silent = []\n", "1 to 8 users"),
        (f'{GATEWAY}stop_when_silent = ["a", "a"]\n', "each once"),
        (f'{GATEWAY}stop_when_silent = "a"\n', "an array of texts"),
        (f'{GATEWAY}stop_when_silent = ["*"]\n', "1 to 32 letters"),
        (f'{GATEWAY}stop_when_silent = ["a"]\nstop_level = "off"\n', "hold, relax, disable"),
        (f'{GATEWAY}stop_level = "hold"\n', "without stop_when_silent"),
        (f'{NETWORK}[portal]\nuser = "op1"\ngrippers = ["left"]\n', "SITE.GRIPPER"),
        (f'{NETWORK}[portal]\nuser = "op1"\ngrippers = ["lab.*"]\n', "1 to 32 letters"),
        (f'{NETWORK}[portal]\nuser = "op1"\ngrippers = []\n', "one at least"),
        (f'{NETWORK}[portal]\nuser = "**"\ngrippers = ["lab.a"]\n', "1 to 32 letters"),
        (
            f'{NETWORK}[portal]\nuser = "a"\ngrippers = ["lab.a"]\nrole = "root"\n',
            "observer, operator, admin",
        ),
        (f'{NETWORK}[portal]\nuser = "a"\ngrippers = ["lab.a"]\nttl_s = 60\n', "0.3 to 5"),
        (
            f'{NETWORK}[portal]\nuser = "a"\ngrippers = ["lab.a"]\nttl_s = 1e400\n',
            "[portal] ttl_s cannot be 1e400: it must be a finite number",
        ),
        (
            f'{NETWORK}[portal]\nuser = "a"\ngrippers = ["lab.a"]\nttl_s = {10**400}\n',
            "[portal] ttl_s cannot be 1000",
        ),
        (f"{NETWORK}[router]\nlisten = []\n", "is empty"),
        (f'{NETWORK}[router]\nlisten = ["x"]\nusers = {{a = "king"}}\n', "observer, operator"),
        (
            NETWORK + "[router]\nlisten = ['x']\nusers = {a = 'admin'}\ngateways = {a = ['l.a']}",
            "another certificate",
        ),
        (f'{NETWORK}[router]\nlisten = ["x"]\ngateways = {{g = "lab.a"}}\n', "array of grippers"),
        ("[network\n", "fleet.toml"),
    ],
)
def test_what_cannot_be_is_refused_and_says_what_can(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(FleetConfigError, match=r"fleet\.toml") as caught:
        load(str(config(tmp_path, text)))
    assert told in str(caught.value)


def test_a_gateway_has_a_dead_mans_switch_if_it_says_for_whom(tmp_path: Path) -> None:
    found = load(str(config(tmp_path, GATEWAY))).gateway
    assert found is not None
    assert found.stop_when_silent == ()
    found = load(str(config(tmp_path, GATEWAY + 'stop_when_silent = ["a", "b"]\n'))).gateway
    assert found is not None
    assert (found.stop_when_silent, found.stop_level) == (["a", "b"], "hold")


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(FleetConfigError, match="No such file"):
        load(str(tmp_path / "none.toml"))


def test_a_machine_without_a_fleet_is_told_how_to_begin(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = str(tmp_path / "fleet.toml")
    monkeypatch.setattr("litegrip_fleet.admin.config.FILE", file)
    with pytest.raises(FleetConfigError, match="litegripctl install-units --fleet"):
        load(file)


@pytest.mark.parametrize("text", [None, "x", NETWORK])
def test_a_stop_without_a_usable_configuration_says_that_none_was_sent(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str | None
) -> None:
    file = tmp_path / "none.toml" if text is None else config(tmp_path, text)
    assert main(["--config", str(file), "stop", "lab"]) == 2
    assert "no stop was sent: use the switch" in capsys.readouterr().err
    assert main(["--config", str(tmp_path / "none.toml"), "list"]) == 2
    assert "no stop was sent" not in capsys.readouterr().err


def test_keys_say_who_asks_and_nothing_else_passes() -> None:
    left = Place("lab", "left")
    caller = caller_in(left.rpc("op1", "ab-1", "operator"))
    assert caller is not None
    assert (caller.user, caller.session, caller.role) == ("op1", "ab-1", "operator")
    assert place_in(left.alive) == left
    assert stopper_in(left.stop("op1")) == "op1"
    for key in (
        left.stop("op1"),
        left.key + "/rpc/op1/ab-1/root",
        left.key + "/rpc/op1/ab-1",
        left.key + "/rpc/*/ab-1/operate",
        left.key + "/rpc/**",
        left.key + "/rpc/op1/ab-1/operate/more",
    ):
        assert caller_in(key) is None
    assert stopper_in(left.key + "/stop/*") is None
    assert place_in("litegripd/2/lab/left/alive") is None
    assert place_in("litegripd/1/*/left/alive") is None


@pytest.mark.parametrize("text", ["", "lab", "lab.", ".left", "lab.left.more", "lab./x", 7])
def test_a_place_is_a_site_and_a_gripper(text: object) -> None:
    with pytest.raises(BadNameError):
        Place.of(text)


def test_the_rules_name_each_user_and_each_gateway_alone() -> None:
    made = rules({"op1": "operator", "viewer": "observer"}, {"robot1": [Place("lab", "left")]})
    assert made["default_permission"] == "deny"
    by_name = {rule["id"]: rule for rule in made["rules"]}
    assert all(rule["permission"] == "allow" for rule in by_name.values())
    asks = by_name["user viewer asks"]["key_exprs"]
    assert asks == [
        "litegripd/1/*/*/rpc/viewer/*/observe",
        "litegripd/1/*/*/stop/viewer",
        "litegripd/1/*/*/hello",
    ]
    assert "litegripd/1/*/*/rpc/op1/*/operate" in by_name["user op1 asks"]["key_exprs"]
    assert not any("/admin" in key for rule in by_name.values() for key in rule["key_exprs"])
    assert all(subject["cert_common_names"] == [subject["id"]] for subject in made["subjects"])
    for policy in made["policies"]:
        (subject,) = policy["subjects"]
        assert all(subject in rule.split() for rule in policy["rules"])
