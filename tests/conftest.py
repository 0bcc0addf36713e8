"""What holds for every test run: signals that are heard, examples, a garbage collector at rest.

What a test run in the background has inherited must not decide about Ctrl-C and hang-ups. A shell
starts background jobs with SIGINT ignored, nohup with SIGHUP; whatever they start inherits that,
and programs that tests start would be deaf to them. A handler is not inherited: they get the
default.
"""

import gc
import signal

from hypothesis import settings

from tests.properties import chosen

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, lambda _number, _frame: None)

settings.load_profile(chosen())


def pytest_collection_finish() -> None:
    """Keep the thousands of collected tests out of the collector's way: they stay to the end."""
    gc.collect()
    gc.freeze()
