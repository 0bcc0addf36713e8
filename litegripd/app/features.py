"""The features of the daemon: one line for each slice, and the list of all methods.

A slice without its lines here does not exist for clients.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from secrets import token_urlsafe

from litegripd.control.controller import Controller
from litegripd.handover.methods import OnRestart, RestartMethods, no_restart
from litegripd.model.motor_types import MotorType
from litegripd.recorder.causes import Dumps
from litegripd.recorder.methods import RecorderMethods
from litegripd.rpc.facts import Facts
from litegripd.rpc.jsonrpc import encode
from litegripd.rpc.method import Feature, Method, methods_of
from litegripd.rpc.methods import CORE
from litegripd.rpc.openrpc import document
from litegripd.rpc.reports import Reporter
from litegripd.rpc.service import RpcService
from litegripd.rpc.sessions import Peer, Role
from litegripd.teleop.link import InProcessLinks, Links
from litegripd.teleop.methods import TeleopMethods
from litegripd.trajectories.file_methods import TrajectoryFileMethods
from litegripd.trajectories.methods import TrajectoryMethods

GROUPS: tuple[type, ...] = (
    *CORE,
    RestartMethods,
    RecorderMethods,
    TrajectoryMethods,
    TrajectoryFileMethods,
    TeleopMethods,
)
"""In the order of their methods in documents."""

METHODS: tuple[Method, ...] = tuple(row for group in GROUPS for row in methods_of(group))

BY_NAME: Mapping[str, Method] = {row.name: row for row in METHODS}


@lru_cache(maxsize=8)
def encoded_document(motor_type: MotorType) -> bytes:
    """Return the OpenRPC document as JSON; the first call takes longer than a tick."""
    return encode(document([row.with_motor(motor_type) for row in METHODS]))


def build_service(
    controller: Controller,
    facts: Facts,
    period_s: float,
    *,
    dumps: Dumps | None = None,
    role_of: Callable[[Peer], Role] = lambda _peer: "admin",
    epoch: str = "0",
    restart: OnRestart = no_restart,
    links: Links | None = None,
    new_token: Callable[[], str] = token_urlsafe,
) -> RpcService:
    """Build the service with all features.

    Teleoperation uses `links`; without them it stays inside the process. `new_token` returns a
    secret that nobody can guess; it proves that a client holds the lease.
    """

    def features(reporter: Reporter) -> Sequence[Feature]:
        files = TrajectoryFileMethods(controller)
        trajectories = TrajectoryMethods(controller, files)
        teleop = TeleopMethods(controller, links or InProcessLinks(), reporter, epoch)
        return (
            Feature((RestartMethods(restart),)),
            Feature((RecorderMethods(dumps or Dumps(controller)),)),
            Feature((trajectories, files), trajectories.session_ended),
            Feature((teleop,)),
        )

    return RpcService(
        controller,
        facts,
        period_s,
        features,
        document=encoded_document(controller.gripper_id.motor_type),
        role_of=role_of,
        new_token=new_token,
    )
