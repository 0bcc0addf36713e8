"""A helper process with operations that only tests have."""

import os
import signal
from collections.abc import Iterator, Mapping

from litegripd.app.helper_main import OPERATIONS, serve


def double(parameters: Mapping[str, object]) -> object:
    return {"twice": [parameters["x"], parameters["x"]]}


def pieces(parameters: Mapping[str, object]) -> Iterator[bytes]:
    for number in range(int(str(parameters["count"]))):
        yield bytes([number]) * 100


def broken(_parameters: Mapping[str, object]) -> Iterator[bytes]:
    yield b"a piece"
    raise ValueError("the disk is on fire")


def no_json(_parameters: Mapping[str, object]) -> object:
    return {1, 2}


def pipe(_parameters: Mapping[str, object]) -> object:
    raise BrokenPipeError("nobody reads")


def die(_parameters: Mapping[str, object]) -> object:
    os.kill(os.getpid(), signal.SIGKILL)
    return None


if __name__ == "__main__":
    serve(
        {
            "double": double,
            "pieces": pieces,
            "broken": broken,
            "no_json": no_json,
            "pipe": pipe,
            "die": die,
            **OPERATIONS,
        }
    )
