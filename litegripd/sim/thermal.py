"""How warm the coil and the driver get: first-order lags, driven by the loss in the windings.

Figures are estimates from the motor's data; a trip is `motor`'s business.
"""

from __future__ import annotations

import math

from litegripd.sim.parameters import SimulatorParameters


class Thermal:
    """Temperatures of coil and driver in °C, advanced in steps of one fixed duration."""

    def __init__(self, parameters: SimulatorParameters, step_s: float) -> None:
        p = parameters
        # Loss in three phases at a current amplitude I: 1.5·R·I², with I = torque / constant.
        self._watts_per_nm2 = 1.5 * p.phase_resistance_ohm / p.torque_constant_nm_a**2
        self._ambient_c = p.ambient_c
        self._gains = (p.winding_k_w, p.housing_k_w, p.driver_k_w)
        times = (p.winding_time_s, p.housing_time_s, p.driver_time_s)
        self._decays = tuple(math.exp(-step_s / time_s) for time_s in times)
        self._winding = self._housing = self._driver = 0.0

    @property
    def coil_c(self) -> float:
        """Temperature of the coil: the winding above its housing, the housing above the room."""
        return self._ambient_c + self._housing + self._winding

    @property
    def driver_c(self) -> float:
        """Temperature of the driver's transistors."""
        return self._ambient_c + self._driver

    def set_coil(self, coil_c: float) -> None:
        """Let the coil have this temperature now, by the winding alone; the housing keeps its."""
        self._winding = coil_c - self._ambient_c - self._housing

    def step(self, mean_square_torque_nm2: float) -> None:
        """Advance by one step over which the squared torque had this mean."""
        watts = self._watts_per_nm2 * mean_square_torque_nm2
        winding_k_w, housing_k_w, driver_k_w = self._gains
        winding_decay, housing_decay, driver_decay = self._decays
        self._winding = _lag(self._winding, winding_k_w * watts, winding_decay)
        self._housing = _lag(self._housing, housing_k_w * watts, housing_decay)
        self._driver = _lag(self._driver, driver_k_w * watts, driver_decay)


def _lag(value: float, towards: float, decay: float) -> float:
    """Return a first-order lag after one step: exact for a constant input."""
    return towards + (value - towards) * decay
