"""A line that is a set-point without an id, recognized without parsing: there may be many.

Such a line is never answered, so that a newer one may take its place unread.
"""

import re

_MARK = b'"stream.set"'
_MOST_BYTES = 512  # more than any that a client has reason to write; it is matched in microseconds
_LOOKS = 8  # so many lines that only name the method are looked at for the newest set-point

_BLANKS = b" \t\r"
_S = rb"[ \t\r]*"
_VALUE = rb'(?:-?\d+(?:\.\d+)?(?:[eE][+-]?\d{1,3})?|"[^"\\\x00-\x1f]*")'
_NAME = (
    rb'"(?:opening_mm|position_rad|openness|valid_s|speed_mm_s|torque_nm|lease|sent_s'
    rb'|stop_generation)"'
)
_MEMBER = _NAME + _S + rb":" + _S + _VALUE + _S
_PARAMS = rb"\{" + _S + rb"(?:" + _MEMBER + rb"(?:," + _S + _MEMBER + rb")*)?\}"
_JSONRPC = rb'"jsonrpc"' + _S + rb":" + _S + rb'"2\.0"'
_METHOD = rb'"method"' + _S + rb":" + _S + _MARK
_ITEM = rb"(?:" + rb"|".join((_JSONRPC, _METHOD, rb'"params"' + _S + rb":" + _S + _PARAMS)) + rb")"
_LINE = re.compile(
    # Three members, and each of the three names: whatever their order, none is there twice. Blanks
    # around it are stripped before: tried one by one, they would take the square of their number.
    rb"(?=[^\n]*" + _JSONRPC + rb")(?=[^\n]*" + _METHOD + rb')(?=[^\n]*"params")\{'
    + _S + _ITEM + _S + rb"(?:," + _S + _ITEM + _S + rb"){2}\}"
)  # fmt: skip


def is_set_point(line: bytes) -> bool:
    """Return whether a line is a well-formed `stream.set` without an id.

    False for anything that is long or spelt in an unusual way: that is only served one by one.
    """
    if len(line) > _MOST_BYTES or _MARK not in line:
        return False
    return _LINE.fullmatch(line.strip(_BLANKS)) is not None


def newest_set_point(text: bytes, begin: int) -> int:
    """Return where the last whole line from `begin` on starts that is a set-point, else -1."""
    at = text.rfind(_MARK, begin)
    for _ in range(_LOOKS):
        if at < 0:
            break
        start = text.rfind(b"\n", begin, at) + 1 or begin
        end = text.find(b"\n", at)
        if end >= 0 and is_set_point(text[start:end]):
            return start
        at = text.rfind(_MARK, begin, start)
    return -1
