"""Which form a type has on the wire, where that is another than its own."""

from collections.abc import Mapping
from typing import Any, get_args

from litegripd.model.jobs import Job
from litegripd.model.motion_config import MotionConfig
from litegripd.model.results import Progress, ReplayProgress, Result
from litegripd.model.state import GripperState, JobSummary
from litegripd.motor.traffic import MotorCounters
from litegripd.rpc.answers import FrameInterval
from litegripd.rpc.facts import ForeignActive, MotionFields, MotorFigures
from litegripd.rpc.notifications import PartialState
from litegripd.rpc.type_schema import Shape
from litegripd.rpc.view import (
    EndState,
    JobEnd,
    JobHead,
    JobNumber,
    JobSummaryView,
    ProgressEnd,
    ProgressHead,
    StateView,
)

FORMS: Mapping[Any, Any] = {
    StateView: GripperState,
    PartialState: Shape("PartialState", (GripperState,), partial=True),
    JobSummary: JobSummaryView,
    Job: Shape("Job", (JobHead, JobEnd)),
    MotionFields: Shape("MotionFields", (MotionConfig, FrameInterval)),
    MotorFigures: Shape("MotorFigures", (MotorCounters, ForeignActive)),
    **{
        kind: Shape(kind.__name__, (ProgressHead, kind, ProgressEnd))
        for kind in (Progress, ReplayProgress)
    },
    **{kind: Shape(kind.__name__, (JobNumber, kind, EndState)) for kind in get_args(Result)},
}
"""`litegripd.rpc.view` makes most of them."""
