"""How a helper tells a daemon that ended from one that crashed, answers left unread or not."""

import json
import socket

import pytest

from litegripd.app import helper_main
from litegripd.io.helper.helper import GOODBYE


@pytest.mark.parametrize("has_unread", [False, True])
@pytest.mark.parametrize("says_goodbye", [False, True])
def test_an_answer_that_nobody_wants_any_more_is_no_crash(
    monkeypatch: pytest.MonkeyPatch, has_unread: bool, says_goodbye: bool
) -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    monkeypatch.setattr(helper_main, "inherited_socket", lambda: theirs)
    done: list[object] = []
    if has_unread:
        theirs.send(b"an answer of before")
    for number in (1, 2):
        ours.send(json.dumps([number, "note", {"number": number}]).encode())
    if says_goodbye:
        ours.send(json.dumps([0, GOODBYE, {}]).encode())
    ours.close()
    operations = {"note": lambda parameters: done.append(parameters["number"])}
    assert helper_main.serve(operations) is says_goodbye
    assert done == [1, 2], "what was sent before the end is done"
