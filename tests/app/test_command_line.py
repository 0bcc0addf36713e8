"""The command line of `litegripd`: what it says of words that it does not know."""

import pytest

from litegripd.app.main import main


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("sim7 --simulat", "unrecognized arguments: --simulat; did you mean --simulate?"),
        ("sim7 --confg=x", "; did you mean --config?"),
        ("sim7 sim8", "unrecognized arguments: sim8; a daemon has one channel: start one for each"),
        ("--simulate sim7 sim8", "; a daemon has one channel: start one for each"),
        (
            "sim7 --simulate bullet",
            "; --simulate takes mujoco, mujoco:SCENE.xml, or nothing behind it",
        ),
        ("sim7 --xyzzy", "unrecognized arguments: --xyzzy\n"),
        ("--simulate", "required: channel\n"),
    ],
)
def test_a_word_that_is_not_known_is_answered_with_one_that_is(
    capsys: pytest.CaptureFixture[str], line: str, told: str
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(line.split())
    assert (ended.value.code, told in capsys.readouterr().err) == (2, True)
