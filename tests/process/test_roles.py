"""Roles by the configuration, for clients of other users: what the kernel says of them counts."""

import grp
import json
import os
import sys

import pytest

from tests.process.daemon_process import SIMULATED, DaemonProcess, daemon_for_all, ran

ASK = """
import os, socket, sys
path, uid, gid, *groups = sys.argv[1:]
os.setgroups([int(group) for group in groups])
os.setgid(int(gid))
os.setuid(int(uid))
s = socket.socket(socket.AF_UNIX)
s.connect(path)
s.sendall(b'{"jsonrpc":"2.0","id":1,"method":"hello"}\\n')
print(s.makefile().readline())
"""
ALICE, BOB, NO_GROUP = 30_001, 30_002, 50_000


def role(running: DaemonProcess, uid: int, *gids: int) -> str:
    command = [sys.executable, "-c", ASK, str(running.socket_path), *map(str, (uid, *gids))]
    done = ran(*command)
    assert done.returncode == 0, done.stderr
    told: str = json.loads(done.stdout)["result"]["role"]
    return told


@pytest.mark.skipif(os.getuid() != 0, reason="only root can become another user")
def test_users_and_groups_have_the_roles_that_the_configuration_gives() -> None:
    lab = grp.getgrgid(1)
    content = f'default = "observer"\noperators = [{ALICE}]\nadmins = ["@{lab.gr_name}"]'
    with daemon_for_all(f"roles-{os.getpid()}", SIMULATED + content) as running:
        assert role(running, 0, 0) == "admin"
        assert role(running, ALICE, NO_GROUP) == "operator"
        assert role(running, ALICE, NO_GROUP, lab.gr_gid) == "admin"
        assert role(running, BOB, NO_GROUP) == "observer"
        assert role(running, BOB, lab.gr_gid) == "admin"
