"""Certificates of etc/zenoh-certificates, read by handshakes; their dates in injected time."""

import asyncio
import logging
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from litegrip_fleet.admin.certificates import (
    DAY_S,
    Certificate,
    CertificateError,
    authorities,
    own,
    problem_of_dates,
    time_left,
    watch,
)
from litegrip_fleet.wire.network import Tls
from tests.process.fleet.fleet_process import CERTIFICATES, make_certificates

YEAR_S = 365 * DAY_S
FROM_S = 1_800_000_000.0


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    return make_certificates(folder, "router.lab", "127.0.0.1", "user:op1", "gateway:robot1")


@pytest.fixture(scope="module")
def others(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_certificates(tmp_path_factory.mktemp("others"), "user:op1")


def files(folder: Path, name: str) -> Tls:
    own_folder = folder / name
    return Tls(*(str(own_folder / file) for file in ("ca.pem", "own.pem", "own.key")))


@pytest.mark.parametrize("name", ["op1", "robot1", "router.lab"])
def test_the_own_certificate_is_read(made: Path, name: str) -> None:
    found = own(files(made, name))
    assert (found.common_name, found.names) == (name, (name,))
    years = 10 if name == "router.lab" else 1
    assert found.until_s - found.from_s == pytest.approx(years * YEAR_S)


@pytest.mark.parametrize("host", ["router.lab", "127.0.0.1"])
def test_a_router_serves_its_own_name(made: Path, host: str) -> None:
    assert own(files(made, host), as_server=True, name=host).names == (host,)
    assert own(files(made, host), as_server=True).common_name == host


def test_a_router_serves_no_other_name(made: Path) -> None:
    for host, other in (("router.lab", "127.0.0.1"), ("127.0.0.1", "router.lab")):
        with pytest.raises(CertificateError, match="not made for this name"):
            own(files(made, host), as_server=True, name=other)


def test_a_user_serves_nobody(made: Path) -> None:
    with pytest.raises(CertificateError, match="another purpose"):
        own(files(made, "op1"), as_server=True)


def test_a_certificate_of_another_authority_is_no_use(made: Path, others: Path) -> None:
    tls = replace(files(made, "op1"), ca=str(others / "ca.pem"))
    with pytest.raises(CertificateError, match="another authority"):
        own(tls)


def test_a_certificate_and_another_key_do_not_belong_together(made: Path, others: Path) -> None:
    tls = replace(files(made, "op1"), key=files(others, "op1").key)
    with pytest.raises(CertificateError, match="belongs to another key"):
        own(tls)


def test_what_is_no_certificate_is_said_to_be_none(made: Path, tmp_path: Path) -> None:
    tls, nothing = files(made, "op1"), tmp_path / "nothing.pem"
    nothing.write_text("nothing", encoding="utf-8")
    for broken in (replace(tls, certificate=str(nothing)), replace(tls, key=str(nothing))):
        with pytest.raises(CertificateError, match="no PEM"):
            own(broken)
    with pytest.raises(CertificateError, match="has no certificate in it"):
        own(replace(tls, ca=str(nothing)))
    with pytest.raises(CertificateError, match="has no certificate in it"):
        authorities(str(nothing))
    with pytest.raises(FileNotFoundError):
        authorities(str(tmp_path / "none.pem"))


def test_a_key_with_a_password_does_not_ask_for_it(made: Path, tmp_path: Path) -> None:
    tls, locked = files(made, "op1"), tmp_path / "locked.key"
    command = ["openssl", "rsa", "-aes256", "-passout", "pass:secret", "-in", tls.key]
    subprocess.run([*command, "-out", str(locked)], check=True, capture_output=True)
    with pytest.raises(CertificateError, match="the key has a password"):
        own(replace(tls, key=str(locked)))


def test_the_authority_is_read(made: Path) -> None:
    (authority,) = authorities(str(made / "op1/ca.pem"))
    assert authority.common_name == "litegrip fleet"
    assert authority.until_s > own(files(made, "op1")).until_s


def test_dates_are_judged_by_the_callers_clock(made: Path) -> None:
    found = own(files(made, "op1"))
    assert problem_of_dates(found, found.from_s + DAY_S) is None
    assert "has been over since" in str(problem_of_dates(found, found.until_s + 1.0))
    assert "valid only from" in str(problem_of_dates(found, found.from_s - 1.0))


# Dates --------------------------------------------------------------------------------------------


def certificate(days: float) -> Certificate:
    return Certificate("op1", (), FROM_S, FROM_S + days * DAY_S, "1")


def test_days_are_counted_down() -> None:
    assert time_left(certificate(29.9), FROM_S).endswith("for 29 days")
    assert time_left(certificate(1.5), FROM_S).endswith("for 1 day")
    assert time_left(certificate(0.5), FROM_S).endswith("for 0 days")


class _OverError(Exception):
    """The virtual time that was wanted is over."""


def watched(
    one: Certificate, days: float, caplog: pytest.LogCaptureFixture, begin_s: float = FROM_S
) -> list[tuple[float, str]]:
    """Return the day and level of each line that is logged in some days of virtual time."""
    now_s = begin_s
    told: list[tuple[float, str]] = []

    def collect() -> None:
        told.extend(((now_s - FROM_S) / DAY_S, record.levelname) for record in caplog.records)
        caplog.clear()

    async def sleep(seconds: float) -> None:
        nonlocal now_s
        assert seconds > 0.0
        collect()
        now_s += seconds
        if now_s > begin_s + days * DAY_S:
            raise _OverError

    with caplog.at_level(logging.INFO), pytest.raises(_OverError):
        asyncio.run(watch(one, now=lambda: now_s, sleep=sleep))
    return told


def test_a_certificate_that_is_good_for_long_is_no_matter(
    caplog: pytest.LogCaptureFixture,
) -> None:
    assert watched(certificate(365), 334, caplog) == []


def test_the_last_30_days_are_warned_of_daily_and_its_end_is_an_error(
    caplog: pytest.LogCaptureFixture,
) -> None:
    told = watched(certificate(40.5), 43, caplog)
    warnings = [day for day, level in told if level == "WARNING"]
    errors = [day for day, level in told if level == "ERROR"]
    assert warnings == [pytest.approx(day) for day in range(11, 41)]
    assert errors == [pytest.approx(day, abs=1e-3) for day in (40.5, 41.5, 42.5)]


def test_a_certificate_from_the_future_is_an_error_at_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    told = watched(certificate(365), 2.5, caplog, FROM_S - 1.5 * DAY_S)
    assert told == [(-1.5, "ERROR"), (-0.5, "ERROR")]


@pytest.mark.parametrize("arguments", [[], ["--help"], ["tls"]])
def test_the_script_says_its_usage_and_makes_nothing(tmp_path: Path, arguments: list[str]) -> None:
    command = ["sh", str(CERTIFICATES), *arguments]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert (
        done.stderr == "usage: zenoh-certificates DIRECTORY NAME... user:NAME... gateway:NAME...\n"
    )
    assert list(tmp_path.iterdir()) == []
