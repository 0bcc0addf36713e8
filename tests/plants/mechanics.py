"""Rotor and fingers, the cable between them, and the current loop that turns the rotor.

Everything counts in the closing direction: 0 is where the rotor stands when the jaws are pressed
together with `PRESS_NM`, the open side is negative. Steps of 0.1 ms, semi-implicit Euler; friction
and dampers can stop a mass but never turn it round.
"""

import math

from tests.plants.parameters import COGS_RAD, MM_RAD, PRESS_NM, TRAVEL_RAD, Item, PlantParameters

STEP_S = 1e-4
STEPS_PER_S = 10_000
ENCODER_COUNTS = 16384  # per turn of the rotor
BRAKE_NM_S_RAD = 0.7 / 10.0**2  # at the rotor of a disabled motor: its phases are shorted
CLOSED_DAMPING, OPEN_DAMPING = 0.13, 0.4  # N·m·s/rad, estimates
HAND_NM_RAD, HAND_DAMPING = 3000.0, 1.0  # a hand that moves the jaws is stiff
_SETTLED = 1e-6  # N·m and rad/s: below this a lag has ended


class Mechanics:
    """Two masses in motion. `rotor_rad` and `finger_rad` count towards closed."""

    def __init__(self, parameters: PlantParameters, opening_mm: float) -> None:
        p = self._p = parameters
        self._count_rad = 2.0 * math.pi / (ENCODER_COUNTS * p.gear)
        self._half = 0.5 * p.backlash_mm / MM_RAD
        self._cable = p.cable_nm_rad
        lags_s = (p.current_lag_s, p.report_lag_s, max(p.speed_lag_s, 1e-6))
        self._lag_gains = [1.0 - math.exp(-STEP_S / lag_s) for lag_s in lags_s]
        self._drags = [
            STEP_S / inertia * share * friction_nm
            for inertia, share in (
                (p.rotor_kg_m2, p.rotor_share),
                (p.finger_kg_m2, 1.0 - p.rotor_share),
            )
            for friction_nm in (p.coulomb_nm, p.breakaway_nm - p.coulomb_nm)
        ]
        self._cable_damping = (
            2.0 * p.cable_damping_ratio * math.sqrt(p.cable_nm_rad * p.finger_kg_m2)
        )
        pressed_nm = PRESS_NM * p.torque_factor
        against_nm = max(pressed_nm - p.coulomb_nm, 0.1)
        # How far the fingers lag behind the rotor when they are pressed against an end.
        self._lag = self._half + (pressed_nm - p.rotor_share * p.coulomb_nm) / p.cable_nm_rad
        self._closed_at = -self._lag - against_nm / p.closed_nm_rad
        self._open_at = -TRAVEL_RAD + self._lag + against_nm / p.open_nm_rad
        self._zone_at = self._closed_at - p.stick_zone_rad
        self.finger_rad = self.rotor_rad = self._at(opening_mm)
        self.rotor_rad_s = self.finger_rad_s = 0.0
        self.torque_nm = self.reported_nm = self.speed_rad_s = 0.0
        """True torque over `torque_factor`, its report, and the speed that the motor measures."""
        self.made_share = 1.0
        """The share of the commanded torque that the motor makes, and reports."""
        self.hand_nm = 0.0
        self.item: Item | None = None
        self.item_at = math.inf
        self.wall_at = math.inf
        """The fingers are kept from closing beyond this by a hand, which moves it."""
        self._wall_rad_s, self._wall_to = 0.0, math.inf
        self._is_moved = False  # by something that needs no force of the jaws
        self.brake()
        self._bound_free_travel()

    def _at(self, opening_mm: float) -> float:
        return -opening_mm / MM_RAD - self._lag

    @property
    def opening_mm(self) -> float:
        """The true opening between the jaws; 0 when they are pressed together."""
        return -(self.finger_rad + self._lag) * MM_RAD

    @property
    def encoder_rad(self) -> float:
        """The rotor's angle as the motor counts it."""
        return math.floor(self.rotor_rad / self._count_rad) * self._count_rad

    @property
    def clamp_nm(self) -> float:
        """The torque that the object feels; 0 without an object."""
        item = self.item
        if item is None or self.finger_rad <= self.item_at:
            return 0.0
        press = item.stiffness_nm_rad * (self.finger_rad - self.item_at)
        return max(press + item.damping_nm_s_rad * self.finger_rad_s, 0.0)

    @property
    def energy_j(self) -> float:
        """What moves, and what is stored in cable, ends and object."""
        p, stretch = self._p, max(abs(self.rotor_rad - self.finger_rad) - self._half, 0.0)
        total = p.rotor_kg_m2 * self.rotor_rad_s**2 + p.finger_kg_m2 * self.finger_rad_s**2
        total += self._cable * stretch**2
        total += p.closed_nm_rad * max(self.finger_rad - self._closed_at, 0.0) ** 2
        total += p.open_nm_rad * max(self._open_at - self.finger_rad, 0.0) ** 2
        if self.item is not None:
            pressed_rad = max(self.finger_rad - self.item_at, 0.0)
            total += self.item.stiffness_nm_rad * pressed_rad**2
        return 0.5 * total

    def drive(self, at: float, speed: float, kp: float, kd: float, torque: float) -> None:
        """Follow kp·(at - measured) + kd·(speed - measured) + torque from now on."""
        self._command = (at, speed, kp, kd, torque)
        self._rotor_damping = self._p.viscous_nm_s_rad

    def brake(self) -> None:
        """Make no torque, and brake."""
        self._command = (0.0, 0.0, 0.0, 0.0, 0.0)
        self.torque_nm = 0.0
        self._rotor_damping = self._p.viscous_nm_s_rad + BRAKE_NM_S_RAD * self._p.gear**2

    def put(self, item: Item | None) -> None:
        """Put an object between the jaws, or take it away."""
        self.item = item
        self.item_at = math.inf if item is None else self._at(item.width_mm)
        self._bound_free_travel()

    def give_way(self, by_mm: float) -> None:
        """Let the object be thinner at once, as one that slips or breaks."""
        self.item_at += by_mm / MM_RAD
        self._bound_free_travel()

    def hold_open(self, by_mm: float, within_s: float) -> None:
        """Let a hand open the jaws so far from where they are."""
        self.wall_at = self.finger_rad
        self._wall_to = self.finger_rad - by_mm / MM_RAD
        self._wall_rad_s = by_mm / MM_RAD / within_s
        self._bound_free_travel()

    def let_go(self) -> None:
        """Let the hand that held the jaws open be gone at once."""
        self.wall_at = self._wall_to = math.inf
        self._bound_free_travel()

    def run(self, steps: int) -> None:  # noqa: C901 - one loop over local variables, for its speed
        """Advance by so many steps; ends early once nothing moves or can begin to."""
        xr, vr, xf, vf = self.rotor_rad, self.rotor_rad_s, self.finger_rad, self.finger_rad_s
        torque, reported, speed = self.torque_nm, self.reported_nm, self.speed_rad_s
        at, dq, kp, kd, forward = self._command
        current_gain, report_gain, speed_gain = self._lag_gains
        limit, no_load = self._p.torque_limit_nm, self._p.no_load_rad_s
        factor, slowness = self._p.torque_factor, 1.0 / self._p.stribeck_rad_s
        made_share, cogging = self.made_share, self._p.cogging_nm
        cable, cable_damping = self._cable, self._cable_damping
        half, hand = self._half, self.hand_nm
        gr, gf = STEP_S / self._p.rotor_kg_m2, STEP_S / self._p.finger_kg_m2
        rotor_coulomb, rotor_extra, finger_coulomb, finger_extra = self._drags
        rotor_factor = 1.0 / (1.0 + gr * self._rotor_damping)
        free_from, free_to = self._free_from, self._free_to
        done, stood, count_rad = 0, 0, self._count_rad
        for done in range(1, steps + 1):
            speed += (vr - speed) * speed_gain
            wanted = kp * (at - xr // count_rad * count_rad) + kd * (dq - speed) + forward
            wanted *= made_share
            if not -limit < wanted < limit or not -no_load < vr < no_load:
                wanted = self._attainable(wanted, vr)
            torque += (wanted - torque) * current_gain
            reported += (torque - reported) * report_gain
            twist = xr - xf
            if twist > half:
                pull = cable * (twist - half) + cable_damping * (vr - vf)
                if pull < 0.0:
                    pull = 0.0
            elif twist < -half:
                pull = cable * (twist + half) + cable_damping * (vr - vf)
                if pull > 0.0:
                    pull = 0.0
            else:
                pull = 0.0
            made = torque * factor
            if cogging:
                made += cogging * math.sin(COGS_RAD * xr)
            swing = vr + gr * (made - pull)
            ratio = vr * slowness
            drag = rotor_coulomb + rotor_extra / (1.0 + ratio * ratio)
            if swing > drag:
                vr = (swing - drag) * rotor_factor
                xr += vr * STEP_S
            elif swing < -drag:
                vr = (swing + drag) * rotor_factor
                xr += vr * STEP_S
            else:
                vr = 0.0
            ratio = vf * slowness
            drag = finger_coulomb + finger_extra / (1.0 + ratio * ratio)
            if free_from < xf < free_to:
                swing = vf + gf * (pull + hand)
                damping = 1.0
            else:
                force, damping, more = self._resist(xf, vf, pull + hand)
                swing = vf + gf * force
                damping = 1.0 + gf * damping
                drag += gf * more
            if swing > drag:
                vf = (swing - drag) / damping
                xf += vf * STEP_S
            elif swing < -drag:
                vf = (swing + drag) / damping
                xf += vf * STEP_S
            else:
                vf = 0.0
                if (
                    vr == 0.0
                    and -_SETTLED < wanted - torque < _SETTLED
                    and -_SETTLED < speed < _SETTLED
                    and not self._is_moved
                ):
                    if stood == done - 1:
                        break
                    stood = done
        reported += (torque - reported) * (1.0 - (1.0 - report_gain) ** (steps - done))
        self.rotor_rad, self.rotor_rad_s, self.finger_rad, self.finger_rad_s = xr, vr, xf, vf
        self.torque_nm, self.reported_nm, self.speed_rad_s = torque, reported, speed

    def _attainable(self, wanted: float, v: float) -> float:
        """Return what the current limit allows, and beyond the no-load speed what brakes."""
        if wanted * v > 0.0 and abs(v) >= self._p.no_load_rad_s:
            return 0.0
        limit = self._p.torque_limit_nm
        return min(max(wanted, -limit), limit)

    def _bound_free_travel(self) -> None:
        """Note between where nothing but friction resists the fingers."""
        self._free_from = self._open_at
        self._free_to = min(self._zone_at, self.item_at)
        self._is_moved = self.wall_at < math.inf
        if self._is_moved:
            self._free_from = math.inf

    def _resist(self, x: float, v: float, force: float) -> tuple[float, float, float]:
        """Return force, damping and more friction where end, object, zone or hand resist.

        None of them pulls: where a damper would, the jaws have come off.
        """
        p, item = self._p, self.item
        damping = more = 0.0
        if self._zone_at < x <= self._closed_at and (v > 0.0 or (v == 0.0 and force > 0.0)):
            ratio = v / p.stick_rad_s
            more = max(p.stick_nm - p.breakaway_nm, 0.0) / (1.0 + ratio * ratio)
        if x > self._closed_at:
            press = p.closed_nm_rad * (x - self._closed_at)
            if press + CLOSED_DAMPING * v > 0.0:
                force -= press
                damping += CLOSED_DAMPING
        elif x < self._open_at:
            press = p.open_nm_rad * (x - self._open_at)
            if press + OPEN_DAMPING * v < 0.0:
                force -= press
                damping += OPEN_DAMPING
        if item is not None and x > self.item_at:
            press = item.stiffness_nm_rad * (x - self.item_at)
            if press + item.damping_nm_s_rad * v > 0.0:
                force -= press
                damping += item.damping_nm_s_rad
                more += item.friction_nm
            self._let_yield(item, press)
        if self.wall_at < math.inf:
            press = self._press_of_wall(x)
            if press > 0.0:
                force -= press
                damping += HAND_DAMPING
        return force, damping, more

    def _let_yield(self, item: Item, press_nm: float) -> None:
        self._is_moved = item.yield_mm_s > 0.0 and press_nm > item.yield_nm
        if self._is_moved:
            self.item_at += item.yield_mm_s / MM_RAD * STEP_S

    def _press_of_wall(self, x: float) -> float:
        self._is_moved = True
        self.wall_at = max(self.wall_at - self._wall_rad_s * STEP_S, self._wall_to)
        return HAND_NM_RAD * (x - self.wall_at)
