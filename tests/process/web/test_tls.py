"""The page under a name of its own, with TLS, in a real browser: both sides prove the secret."""

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, expect

from tests.process.daemon_process import DEADLINE_S, Client
from tests.process.web.on_page import enable, opened, part
from tests.process.web.page_process import Page, page

NAME = "robot.lab"
"""The browser of the tests takes it for this machine."""

pytestmark = pytest.mark.skipif(
    shutil.which("openssl") is None, reason="needs openssl for its certificate"
)


@pytest.fixture(scope="module")
def encrypted(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, ...]:
    """Return the options for a certificate that nobody has signed but itself."""
    folder = tmp_path_factory.mktemp("tls")
    certificate, key = str(folder / "own.pem"), str(folder / "own.key")
    command = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2"]
    subject = ["-subj", f"/CN={NAME}", "-addext", f"subjectAltName=DNS:{NAME}"]
    subprocess.run(
        [*command, *subject, "-keyout", key, "-out", certificate], check=True, capture_output=True
    )
    return ("--certificate", certificate, "--key", key, "--name", NAME)


@pytest.fixture
def window(chromium: Browser) -> Iterator[BrowserContext]:
    """A window of somebody who has accepted the certificate."""
    window = chromium.new_context(ignore_https_errors=True)
    window.set_default_timeout(DEADLINE_S * 1000)
    yield window
    window.close()


def named(running: Page) -> Page:
    """Return a page as it is known by its name."""
    running.told = running.told.replace("127.0.0.1", NAME)
    assert running.told.startswith(f"https://{NAME}:")
    return running


def test_under_another_name_the_page_moves_and_stops(
    window: BrowserContext, encrypted: tuple[str, ...], place: Path, client: Client
) -> None:
    with page(*encrypted, "--socket", str(place), "--operate") as running:
        tab = opened(window, named(running))
        enable(tab, client)
        tab.keyboard.press("o")
        client.until(lambda state: bool(state["job"] and state["job"]["kind"] == "open"))
        tab.keyboard.press("Escape")
        client.until(lambda state: state["stop"] is not None)
        expect(part(tab, "mode")).to_have_text("STOPPED")


def test_under_another_name_a_stranger_at_the_port_is_not_given_the_proof(
    window: BrowserContext, encrypted: tuple[str, ...], place: Path, client: Client
) -> None:
    options = (*encrypted, "--socket", str(place), "--operate")
    with page(*options) as running:
        tab = opened(window, named(running))
        sent: list[str | bytes] = []

        def keep(text: str | bytes) -> None:
            sent.append(text)

        tab.on("websocket", lambda line: line.on("framesent", keep))
    with page(*options, f"--port={running.port}"):  # another secret
        expect(part(tab, "why")).to_contain_text("does not know this page's secret")
        expect(part(tab, "mode")).to_have_text("no connection")
    assert sent
    assert all(str(text).startswith('{"nonce":') for text in sent)
    assert running.token not in "".join(map(str, sent))
    with page(*options) as other:
        wrong = window.new_page()
        wrong.goto(f"https://{NAME}:{other.port}/#{'x' * 43}")
        expect(part(wrong, "why")).to_contain_text("was not told it")
