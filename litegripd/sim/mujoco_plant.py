"""MuJoCo's mechanics behind the simulated motor: jaws that meet the bodies of a scene.

A scene says what the jaws are, where they end, and what is around them. Its joint `shaft` is the
output shaft of the motor, whose inertia, friction and torque are set here. Anything else that a
scene has is MuJoCo's business: it moves as it moves, and no actuator of it is driven.
"""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from litegripd.sim.drive import Scene
from litegripd.sim.plant import STEP_S, GrippedObject, SimulatorParameters

SCENE = Path(__file__).with_name("scene.xml")
"""The scene that is taken unless another one is named: a loose cube of 30 mm on a table."""

SHAFT = "shaft"
START = "start"

STEPS = 2
"""Steps of the drive in one of MuJoCo's, which is so 0.5 ms long."""

_STANDS_RAD_S = 1e-3
"""A friction of MuJoCo lets what it holds creep, much slower than this."""

_JAMMED_NM = 1000.0
"""What blocks the shaft is a friction that no torque of the motor overcomes."""

_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
"""All that the next step depends on."""


class MujocoPlant:
    """The mechanics of a scene; see `drive.Mechanics`.

    The time step is 0.5 ms, whatever the scene says. The scene begins as its keyframe `start` has
    it, where there is one.

    Raises `ValueError`, with what is missing, for a file that MuJoCo cannot load, or that is no
    such scene.
    """

    def __init__(self, parameters: SimulatorParameters, scene: Path = SCENE) -> None:
        self._scene = scene
        model = _loaded(scene)
        joint = _shaft(model, scene)
        self._angle_at = int(model.jnt_qposadr[joint])
        dof = self._dof = int(model.jnt_dofadr[joint])
        model.opt.timestep = STEPS * STEP_S
        model.dof_armature[dof] = parameters.rotor_inertia_kg_m2
        # Friction as hard as MuJoCo has it: held jaws creep by less than 0.001 mm/s.
        model.dof_solref[dof] = (2.0 * model.opt.timestep, 1.0)
        model.dof_solimp[dof] = (0.9999, 0.9999, 0.001, 0.5, 2.0)
        data = mujoco.MjData(model)
        self._model, self._data = model, data
        self._looked_at = mujoco.MjData(model)
        mujoco.mj_setConst(model, data)
        start = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, START)
        if start >= 0:
            mujoco.mj_resetDataKeyframe(model, data, start)
        self._friction_nm = (parameters.coulomb_nm, parameters.breakaway_nm)
        self._viscous_nm_s_rad = parameters.viscous_nm_s_rad
        self._hand_nm = self._hand_damping_nm_s_rad = 0.0
        self.is_jammed = False
        self._torque_nm = 0.0  # the sum over the drive's steps since MuJoCo's last
        self._steps = 0
        self.brake(0.0)
        self._prepare()

    def __deepcopy__(self, memo: dict[int, Any]) -> MujocoPlant:
        other = copy.copy(self)
        for name in ("_model", "_data", "_looked_at"):
            setattr(other, name, copy.deepcopy(getattr(self, name), memo))
        return other

    def _prepare(self) -> None:
        """Note where the shaft is, and let MuJoCo find what will resist it in its next step."""
        self.angle_rad = float(self._data.qpos[self._angle_at])
        speed = self.speed_rad_s = float(self._data.qvel[self._dof])
        moving_nm, still_nm = self._friction_nm
        friction_nm = still_nm if -_STANDS_RAD_S < speed < _STANDS_RAD_S else moving_nm
        self._model.dof_frictionloss[self._dof] = _JAMMED_NM if self.is_jammed else friction_nm
        mujoco.mj_step1(self._model, self._data)

    can_rest = False
    """What is loose in a scene may move the jaws at any time."""

    @property
    def clamp_nm(self) -> float:
        """What the shaft passes on to the fingers in the closing direction, as torque."""
        # The same state in another place: in older versions looking would change how it goes on.
        data = self._looked_at
        state = np.empty(mujoco.mj_stateSize(self._model, _STATE))
        mujoco.mj_getState(self._model, self._data, state, _STATE)
        mujoco.mj_setState(self._model, data, state, _STATE)
        mujoco.mj_forward(self._model, data)
        is_equality = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        torques = np.zeros(self._model.nv)
        mujoco.mj_mulJacTVec(self._model, data, torques, np.where(is_equality, data.efc_force, 0.0))
        return max(-float(torques[self._dof]), 0.0)

    @property
    def gripped_object(self) -> GrippedObject | None:
        """None: what is between the jaws are bodies of the scene."""
        return None

    def step(self, torque_nm: float) -> tuple[float, float]:
        """Advance by `STEP_S` under this torque; return angle and speed.

        Both change with every `STEPS`th call, under the mean of the torques.
        """
        self._torque_nm += torque_nm
        self._steps += 1
        if self._steps == STEPS:
            self._data.qfrc_applied[self._dof] = self._torque_nm / STEPS + self._hand_nm
            mujoco.mj_step2(self._model, self._data)
            self._prepare()
            self._torque_nm = 0.0
            self._steps = 0
        return self.angle_rad, self.speed_rad_s

    def brake(self, damping_nm_s_rad: float) -> None:
        """Let the shaft be braked in proportion to its speed until the next call."""
        self._own_damping_nm_s_rad = self._viscous_nm_s_rad + damping_nm_s_rad
        self._damp()

    @property
    def hand_nm(self) -> float:
        """The torque of the hand that pushes the jaws."""
        return self._hand_nm - self._hand_damping_nm_s_rad * self.speed_rad_s

    def push(self, torque_nm: float, damping_nm_s_rad: float = 0.0) -> None:
        """Let a hand push with this torque until the next call; 0 lets go.

        With damping it pushes less, the faster the jaws yield: it leads them at a speed.
        """
        self._hand_nm, self._hand_damping_nm_s_rad = torque_nm, damping_nm_s_rad
        self._damp()

    def _damp(self) -> None:
        damping_nm_s_rad = self._own_damping_nm_s_rad + self._hand_damping_nm_s_rad
        self._model.dof_damping[self._dof] = damping_nm_s_rad

    def jam(self, *, jammed: bool) -> None:
        """Let something block the shaft where it is, whatever the torque; or let go of it."""
        self.is_jammed = jammed
        self._prepare()

    def put(self, item: GrippedObject | None) -> None:
        """Take nothing away; raises `ValueError` for an object, which would be no body."""
        if item is not None:
            raise ValueError(
                "MuJoCo's jaws meet the bodies of their scene alone; put the object into the"
                " scene: --simulate mujoco:SCENE.xml"
            )

    def give_way(self, way_mm: float) -> None:
        """Raise `ValueError`: what gives way, and how, is a matter of the scene's bodies."""
        raise ValueError(f"no body of MuJoCo's scene gives way by {way_mm:g} mm at once")

    def scene(self) -> Scene:
        """Return the file and where all joints of it are."""
        return Scene(self._scene, float(self._data.time), self._data.qpos.tolist())


def _loaded(scene: Path) -> Any:
    try:
        return mujoco.MjModel.from_xml_path(str(scene))
    except ValueError as error:
        raise ValueError(f"MuJoCo cannot load {scene}: {' '.join(str(error).split())}") from None


def _shaft(model: Any, scene: Path) -> int:
    """Return the index of the motor's joint."""
    joint = int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, SHAFT))
    if joint < 0:
        names = ", ".join(sorted(model.joint(at).name for at in range(model.njnt))) or "none"
        raise ValueError(
            f"{scene} has no joint {SHAFT!r}, which is the motor's output shaft (its joints:"
            f" {names}); docs/mujoco.md says what a scene needs"
        )
    if model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_HINGE:
        raise ValueError(f"the joint {SHAFT!r} of {scene} is no hinge, as the motor's shaft is")
    return joint
