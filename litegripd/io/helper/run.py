"""Runs a module of this version in a child process: `python run.py MODULE ARGUMENT...`.

`python -m MODULE` would look in the current directory first. The folders of the parent's modules
come by the environment, so that lists of processes show short command lines. Nothing of the
project can be imported before they are set.
"""

import os
import runpy
import sys

if __name__ == "__main__":
    sys.path[:] = os.environ["LITEGRIPD_MODULES"].split(os.pathsep)
    runpy.run_module(sys.argv.pop(1), run_name="__main__", alter_sys=True)
