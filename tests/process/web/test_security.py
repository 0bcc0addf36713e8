"""Each point of the page's security, and who tries to break it.

A robot's page is asked by every other page that its user has open, by names that were made to lead
to it, and by whoever else is on the machine.
"""

import contextlib
import json
import logging
import os
import re
import shutil
import socket
import ssl
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from litegrip_web.allowed import ACT, MOVE, READ
from litegrip_web.bridge import LATE_S, MOST_BROWSERS, TOO_LATE, TOO_MANY, WRONG_TOKEN
from litegrip_web.main import main
from litegrip_web.options import EXIT_USAGE
from litegrip_web.proof import proof
from litegrip_web.server import SECURITY_HEADERS
from litegripd.app.build import METHODS, SIMULATED_METHODS
from tests.process.daemon_process import DEADLINE_S, SIMULATED, daemon_for_all, ran
from tests.process.web.page_process import (
    CHANNEL,
    NONCE,
    Page,
    StandIn,
    ask,
    page,
    prove,
    reason,
    request,
    stand_in,
    welcome,
)

ETC = Path(__file__).parents[3] / "etc"
FORBIDDEN = sorted({row.name for row in (*METHODS, *SIMULATED_METHODS)} - READ - ACT - {"stop"})


@pytest.fixture(scope="module")
def listening(tmp_path_factory: pytest.TempPathFactory) -> Iterator[StandIn]:
    with stand_in(tmp_path_factory.mktemp("there")) as running:
        yield running


@pytest.fixture
def daemon_there(listening: StandIn) -> StandIn:
    """Return what stands in for the daemon, as if nothing had reached it yet."""
    listening.forget()
    return listening


@pytest.fixture(scope="module")
def shown(listening: StandIn) -> Iterator[Page]:
    """One page for all tests, none of which leaves it another one."""
    with page("--socket", str(listening.path)) as running:
        yield running


@pytest.fixture(scope="module")
def operated(listening: StandIn) -> Iterator[Page]:
    with page("--socket", str(listening.path), "--operate") as running:
        yield running


@pytest.fixture
def crowded(daemon_there: StandIn) -> Iterator[Page]:
    """A page for one test alone, which fills it."""
    with page("--socket", str(daemon_there.path)) as running:
        yield running


@pytest.mark.parametrize("host", ["evil.example", "evil.example:{port}", "127.0.0.1", "", "[::1]"])
def test_a_foreign_host_gets_nothing(shown: Page, host: str) -> None:
    answer = shown.get(Host=host.format(port=shown.port))
    assert answer.status == 421
    assert b"<html" not in answer.read()


def test_a_name_that_was_made_to_lead_here_cannot_connect(shown: Page) -> None:
    name = f"evil.example:{shown.port}"
    with pytest.raises(InvalidStatus) as refused, shown.connect(host=name, origin=f"http://{name}"):
        pass
    assert refused.value.response.status_code == 421


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "https://127.0.0.1:{port}", "http://localhost", None]
)
def test_a_foreign_page_cannot_connect(
    shown: Page, daemon_there: StandIn, origin: str | None
) -> None:
    given = origin and origin.format(port=shown.port)
    with pytest.raises(InvalidStatus) as refused, shown.connect(origin=given):
        pass
    assert refused.value.response.status_code == 403
    assert daemon_there.lines == []


def test_our_own_names_are_allowed(shown: Page) -> None:
    for name in (f"localhost:{shown.port}", f"[::1]:{shown.port}"):
        assert shown.get(Host=name).status == 200
        with shown.connect(origin=f"http://{name}") as browser:
            assert welcome(browser)["channel"] == CHANNEL


def test_a_further_name_is_allowed_by_name(daemon_there: StandIn) -> None:
    with page("--socket", str(daemon_there.path), "--name", "robot.lab") as shown:
        name = f"robot.lab:{shown.port}"
        assert shown.get(Host=name).status == 200
        with shown.connect(host=name, origin=f"http://{name}") as browser:
            assert welcome(browser)["channel"] == CHANNEL


@pytest.mark.parametrize("path", ["/", "/main.js", "/nowhere", "/ws/other", f"/ws/{CHANNEL}"])
@pytest.mark.parametrize("host", ["localhost:{port}", "evil.example"])
def test_every_answer_has_the_headers_and_no_cookie_and_lets_no_page_read_it(
    shown: Page, path: str, host: str
) -> None:
    answer = shown.get(path, Host=host.format(port=shown.port), Origin="http://evil.example")
    told = {name.lower(): value for name, value in answer.getheaders()}
    assert (
        SECURITY_HEADERS.items()
        <= {name: told.get(name.lower()) for name in SECURITY_HEADERS}.items()
    )
    policy = told["content-security-policy"]
    assert policy.startswith("default-src 'self';")
    assert "frame-ancestors 'none'" in policy
    assert [name for name in told if name.startswith("access-control") or "cookie" in name] == []


@pytest.mark.parametrize(
    "path",
    ["/../main.py", "/..%2fmain.py", "/%2e%2e/main.py", "//etc/passwd", "/vendor/../../server.py"],
)
def test_no_path_leads_out_of_the_page(shown: Page, path: str) -> None:
    assert shown.get(path).status == 404


def closed_with(browser: ClientConnection) -> int:
    """Wait until a connection is closed before anything has come by it; return the code."""
    with pytest.raises(ConnectionClosed) as closed:
        browser.recv(DEADLINE_S)
    assert closed.value.rcvd is not None
    return closed.value.rcvd.code


def other_proofs(page: Page, told: dict[str, str]) -> dict[str, object]:
    """Return what is no proof of the page's, given what the server told."""
    host, nonce = f"127.0.0.1:{page.port}", told["nonce"]
    return {
        "another secret": proof("x" * 43, "page", host, NONCE, nonce),
        "another role": told["proof"],
        "another host": proof(page.token, "page", "127.0.0.1:80", NONCE, nonce),
        "another nonce": proof(page.token, "page", host, NONCE, NONCE),
        "the secret": page.token,
        "empty": "",
        "no ascii": "ü",
        "half a surrogate": "\ud800",
        "none": None,
        "a number": 1,
    }


@pytest.mark.parametrize(
    "which",
    [
        *other_proofs(
            cast(Page, SimpleNamespace(port=0, token="")), dict.fromkeys(("nonce", "proof"), "")
        )
    ],
)
def test_without_the_secret_a_browser_is_told_nothing(
    shown: Page, daemon_there: StandIn, which: str
) -> None:
    with shown.connect(token=None) as browser:
        told = ask(browser, json.dumps({"nonce": NONCE}))
        browser.send(json.dumps({"proof": other_proofs(shown, told)[which]}))
        assert closed_with(browser) == WRONG_TOKEN
    assert daemon_there.lines == []


def test_the_server_proves_that_it_knows_the_secret_and_sends_it_to_nobody(shown: Page) -> None:
    host = f"127.0.0.1:{shown.port}"
    with shown.connect(token=None) as browser:
        text = json.dumps({"nonce": NONCE})
        browser.send(text)
        received = browser.recv(DEADLINE_S)
    told = json.loads(received)
    assert told["proof"] == proof(shown.token, "server", host, NONCE, told["nonce"])
    assert shown.token not in received
    with shown.connect(token=None) as browser:
        assert ask(browser, text)["nonce"] != told["nonce"]


def test_hundreds_of_strangers_keep_nobody_out(shown: Page) -> None:
    with contextlib.ExitStack() as strangers:
        for _ in range(300):
            address = ("127.0.0.1", shown.port)
            strangers.enter_context(socket.create_connection(address, timeout=DEADLINE_S))
        assert shown.get().status == 200
        with shown.connect() as browser:
            assert welcome(browser)["channel"] == CHANNEL
            for _ in range(300):
                strangers.enter_context(socket.create_connection(address, timeout=DEADLINE_S))
            assert ask(browser, request("state.get"))["result"] == "state.get"


@pytest.mark.parametrize(
    "first",
    [
        "",
        "[]",
        "17",
        '{"nonce": 1}',
        '{"nonce": "short"}',
        '{"nonce": "\\ud800"}',
        request("state.get"),
        request("stop", level="hold"),
    ],
)
def test_without_the_token_a_browser_is_told_nothing_and_not_heard(
    shown: Page, daemon_there: StandIn, first: str
) -> None:
    with shown.connect(token=None) as browser:
        browser.send(first)
        assert closed_with(browser) == WRONG_TOKEN
    assert daemon_there.lines == daemon_there.stops == []


def test_who_is_silent_about_the_token_is_closed(daemon_there: StandIn) -> None:
    with (
        page("--socket", str(daemon_there.path), token_within_s=0.2) as hasty,
        hasty.connect(token=None) as browser,
    ):
        assert closed_with(browser) == TOO_LATE


def test_the_token_is_another_one_each_time_and_is_in_no_page(daemon_there: StandIn) -> None:
    tokens = set()
    for _ in range(2):
        with page("--socket", str(daemon_there.path)) as shown:
            tokens.add(shown.token)
            assert len(shown.token) >= 43  # 32 bytes
            assert shown.token.encode() not in shown.get("/").read()
    assert len(tokens) == 2


def test_a_token_file_is_made_kept_and_not_printed(
    tmp_path: Path, daemon_there: StandIn, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "token"
    arguments = ("--socket", str(daemon_there.path), "--token-file", str(file))
    for _ in range(2):
        with page(*arguments) as shown:
            token = file.read_text("ascii").strip()
            assert token not in shown.told
            with shown.connect(token=token) as browser:
                assert welcome(browser)["channel"] == CHANNEL
    assert file.stat().st_mode & 0o007 == 0
    file.write_text("short")
    assert "remove it" in refusal(capsys, *arguments)


def test_a_message_that_is_too_long_ends_the_connection(shown: Page, daemon_there: StandIn) -> None:
    with shown.connect() as browser:
        welcome(browser)
        browser.send(request("state.get", fields=["x" * 16_384]))
        assert closed_with(browser) == 1009
    assert daemon_there.lines == []


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "parse_error"),
        ("{", "parse_error"),
        ("[" * 8000, "parse_error"),
        ('{"id":1,"method":"state.get","method":"motion.open"}', "parse_error"),
        ('{"id":1,"method":"state.get","params":{"a":1,"a":2}}', "parse_error"),
        (b"\x00\xff", "invalid_request"),
        ("[]", "invalid_request"),
        ("null", "invalid_request"),
        ('{"id":1,"method":"state.get","params":[1]}', "invalid_params"),
        ('{"id":1}', "invalid_request"),
        ('{"id":1,"method":["stop"]}', "invalid_request"),
        ('{"id":1,"method":"STATE.GET"}', "not_permitted"),
        ('{"id":1,"method":"state.get","params":{"note":"\\ud800"}}', "invalid_request"),
        (f'{{"id":1,"method":"state.get","params":{{"n":[{"1E5," * 3500}1]}}}}', "invalid_request"),
    ],
)
def test_a_malformed_message_is_refused_and_reaches_no_daemon(
    operated: Page, daemon_there: StandIn, text: str | bytes, why: str
) -> None:
    with operated.connect() as browser:
        welcome(browser)
        assert reason(ask(browser, text)) == why
        assert daemon_there.lines == []
        assert ask(browser, request("state.get"))["result"] == "state.get"


def test_a_message_is_one_line_however_it_is_written(shown: Page, daemon_there: StandIn) -> None:
    with shown.connect() as browser:
        welcome(browser)
        text = '{"id":1,\n"method":"state.get",\n"params":{"note":"a\\nb"}\n}\n'
        assert ask(browser, text)["result"] == "state.get"
    (line,) = daemon_there.lines
    assert line["params"] == {"note": "a\nb"}


def is_turned_away(shown: Page) -> bool:
    with shown.connect() as browser:
        try:
            welcome(browser)
        except ConnectionClosed as closed:
            return closed.rcvd is not None and closed.rcvd.code == TOO_MANY
    return False


def test_a_ninth_browser_is_turned_away_until_one_has_gone(crowded: Page) -> None:
    with contextlib.ExitStack() as others, crowded.connect() as first:
        welcome(first)
        for _ in range(MOST_BROWSERS - 1):
            welcome(others.enter_context(crowded.connect()))
        assert is_turned_away(crowded)
        first.close()
        while is_turned_away(crowded):
            continue  # that it has gone is known when its connection to the daemon has ended


def test_who_lacks_the_token_takes_nobodys_place(crowded: Page) -> None:
    with contextlib.ExitStack() as silent:
        for _ in range(MOST_BROWSERS + 4):
            silent.enter_context(crowded.connect(token=None))
        with crowded.connect() as browser:
            assert welcome(browser)["channel"] == CHANNEL


@pytest.mark.parametrize("method", sorted(ACT))
def test_without_operate_nothing_acts(shown: Page, daemon_there: StandIn, method: str) -> None:
    with shown.connect() as browser:
        assert welcome(browser)["operate"] is False
        answer = ask(browser, request(method))
        assert reason(answer) == "not_permitted"
        assert "--operate" in answer["error"]["message"]
    assert daemon_there.lines == []


def test_what_is_for_the_shell_is_not_for_a_page(operated: Page, daemon_there: StandIn) -> None:
    with operated.connect() as browser:
        assert welcome(browser)["operate"] is True
        for method in FORBIDDEN:
            assert reason(ask(browser, request(method))) == "not_permitted", method
    assert daemon_there.lines == []
    assert {"daemon.restart", "config.set", "motor.set_zero", "calibration.load"} <= set(FORBIDDEN)


def test_the_methods_of_both_lists_exist_and_reading_needs_no_role() -> None:
    rows = {row.name: row for row in (*METHODS, *SIMULATED_METHODS)}
    assert rows.keys() >= READ | ACT
    assert {name for name in READ if rows[name].role != "observer"} == set()
    assert not READ & ACT


def test_a_stop_needs_only_the_token_and_passes_a_stuck_daemon(
    shown: Page, daemon_there: StandIn
) -> None:
    daemon_there.is_stuck = True
    with shown.connect() as browser:
        welcome(browser)
        browser.send(request("state.get"))
        daemon_there.until(lambda there: len(there.lines) == 1)
        answer = ask(browser, request("stop", level="hold", why="test"))
        assert answer["result"] == {"level": "hold", "generation": 1}
    (stop,) = daemon_there.stops
    assert stop["params"] == {"level": "hold", "why": "test"}


def test_a_stop_that_its_socket_would_not_understand_goes_by_the_connection(
    shown: Page, daemon_there: StandIn
) -> None:
    with shown.connect() as browser:
        welcome(browser)
        assert ask(browser, request("stop", level="freeze"))["result"] == "stop"
    assert daemon_there.stops == []


@pytest.mark.parametrize("params", ["[]", "null", "{}"])
def test_a_stop_without_parameters_is_a_stop(
    shown: Page, daemon_there: StandIn, params: str
) -> None:
    with shown.connect() as browser:
        welcome(browser)
        text = f'{{"jsonrpc":"2.0","id":1,"method":"stop","params":{params}}}'
        assert ask(browser, text)["result"] == "stop"
    (line,) = daemon_there.lines
    assert (line["method"], line["params"]) == ("stop", {})


@pytest.mark.parametrize("method", sorted(ACT))
def test_what_comes_late_moves_nothing(operated: Page, daemon_there: StandIn, method: str) -> None:
    """What holds, lets go, or ends something is welcome at any time."""
    with operated.connect() as browser:
        welcome(browser)
        now_s = ask(browser, request("web.clock"))["result"]["monotonic_s"]
        for sent_s in (now_s, now_s - LATE_S - 0.5):
            answer = ask(browser, json.dumps({**json.loads(request(method)), "sent_s": sent_s}))
            if sent_s == now_s or method not in MOVE:
                assert answer["result"] == method
            else:
                assert reason(answer) == "late"
                assert re.search(r"it came [12]\.\d s after", answer["error"]["message"])
        wrong = ask(browser, json.dumps({**json.loads(request(method)), "sent_s": "now"}))
        assert ("result" in wrong) == (method not in MOVE)
    assert all("sent_s" not in line for line in daemon_there.lines)
    assert MOVE <= ACT


def test_many_stops_are_few_at_the_daemon_and_each_is_answered(
    shown: Page, daemon_there: StandIn
) -> None:
    with shown.connect() as browser:
        welcome(browser)
        for _ in range(200):
            browser.send(request("stop", level="hold"))
        for _ in range(200):
            answer = json.loads(browser.recv(DEADLINE_S))
            assert answer["result"] == {"level": "hold", "generation": 1}
    assert 1 <= len(daemon_there.stops) < 100


def refusal(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """Run it in this process where it must refuse what it is asked for; return what it says."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(logging.getLogger(), "handlers", [])
        patch.setattr(logging.getLogger("websockets.server"), "level", logging.NOTSET)
        assert main([CHANNEL, *arguments]) == EXIT_USAGE
    return capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        *(
            (("--address", address), "--certificate and --key")
            for address in ("0.0.0.0", "::", "192.0.2.1", "robot.lab")
        ),
        (("--certificate", "/nowhere.pem"), "belong together"),
        (("--certificate", "/nowhere.pem", "--key", "/nowhere.key"), "cannot be used"),
        (("--port", "70000"), "0 to 65535"),
        ((CHANNEL,), "named twice"),
        (("can8", "--socket", "/x.sock"), "a single channel"),
        (("../x",), "cannot be a channel"),
    ],
)
def test_wrong_usage_is_said(
    capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], why: str
) -> None:
    assert why in refusal(capsys, *arguments)


def test_it_listens_on_this_machine_alone(shown: Page) -> None:
    rows = [line.split() for line in Path("/proc/net/tcp").read_text("ascii").splitlines()[1:]]
    rows += [line.split() for line in Path("/proc/net/tcp6").read_text("ascii").splitlines()[1:]]
    own = [row[1] for row in rows if row[1].endswith(f":{shown.port:04X}") and row[3] == "0A"]
    assert own == [f"0100007F:{shown.port:04X}"]


@pytest.mark.skipif(shutil.which("openssl") is None, reason="needs openssl for its certificate")
def test_with_tls_another_address_is_served_and_only_encrypted(
    tmp_path: Path, daemon_there: StandIn
) -> None:
    command = [str(ETC / "zenoh-certificates"), str(tmp_path / "tls"), "127.0.0.1"]
    subprocess.run(command, check=True, capture_output=True)
    own = tmp_path / "tls" / "127.0.0.1"
    with page(
        *("--socket", str(daemon_there.path), "--address", "0.0.0.0", "--name", "127.0.0.1"),
        *("--certificate", str(own / "own.pem"), "--key", str(own / "own.key")),
    ) as shown:
        assert shown.url.startswith("https://")
        trusted = ssl.create_default_context(cafile=str(own / "ca.pem"))
        host = f"127.0.0.1:{shown.port}"
        own_page = Origin(f"https://{host}")
        address = f"wss://{host}/ws/{CHANNEL}"
        with connect(address, ssl=trusted, origin=own_page, proxy=None) as browser:
            prove(browser, shown.token, host)
            assert welcome(browser)["channel"] == CHANNEL
        with socket.create_connection(("127.0.0.1", shown.port), timeout=DEADLINE_S) as plain:
            plain.sendall(b"GET / HTTP/1.1\r\nHost: x\r\n\r\n")
            with pytest.raises((ConnectionResetError, AssertionError)):
                assert plain.recv(1000).startswith(b"HTTP")


def test_a_port_that_is_taken_is_said(shown: Page) -> None:
    done = ran(sys.executable, "-m", "litegrip_web", CHANNEL, "--port", str(shown.port))
    assert done.returncode == 1
    assert "--port takes another" in done.stderr


def test_a_missing_package_is_named_with_what_installs_it() -> None:
    program = "import sys; sys.modules['websockets'] = None; import litegrip_web.__main__ as page"
    done = ran(sys.executable, "-c", f"{program}; sys.exit(page.main())", CHANNEL)
    assert done.returncode == 5
    assert "websockets" in done.stderr
    assert "-m pip install 'websockets>=" in done.stderr


@pytest.mark.skipif(os.getuid() != 0, reason="only root can become another user")
def test_the_daemons_roles_bound_the_page_a_second_time() -> None:
    nobody = 65_534
    with daemon_for_all(CHANNEL, f'{SIMULATED}default = "observer"\n') as running:
        arguments = ("--socket", str(running.socket_path), "--operate")
        with page(*arguments, uid=nobody) as operated, operated.connect() as browser:
            assert welcome(browser)["operate"] is True
            answer = ask(browser, request("motor.enable"))
            assert reason(answer) == "not_permitted"
            assert f"uid {nobody} is an observer" in answer["error"]["message"]
