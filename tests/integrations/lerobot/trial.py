"""LeRobot's own commands on simulated grippers: what they record, replay and are refused.

python -m tests.integrations.lerobot.trial ENVIRONMENT [SCENE ...]

ENVIRONMENT has LeRobot, litegrip-client, the plug-in and the trial's arm: `make lerobot` makes it.
Prints a table; the exit code is 1 if something is not as it must be.
"""

from __future__ import annotations

import json
import math
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

from PIL import Image, ImageDraw

from litegrip_client import LiteGrip
from tests.integrations.lerobot.grippers import ON_MUJOCO, SWEEP_S, Log, daemon, move, simulated
from tests.integrations.lerobot.measures import Track, delay_s, drifting, sweeps
from tests.integrations.lerobot.sight import ROW, expected_px, seen_px
from tests.process.fleet.fleet_process import HOST, SITE, fleet, make_certificates

HERE = Path(__file__).parent
FPS = 30
TRAVEL_MM = 86.99
MOST_OFF = 0.005
MOST_LAG_S, MOST_LAG_BY_PORTAL_S = 0.060, 0.080
FASTEST_CALM_MM_S = 76.0
MOST_REPLAY_RMS = 0.03
IMAGES_A_SECOND, IMAGE, MOST_PX_OFF = 15, (320, 240), 3.0
ROW_PX = int(ROW * IMAGE[1])
_ZERO = re.compile(r"gripper (\S+): stamps count from (\S+) s")
_WITHIN_S = 240.0


@dataclass
class Trial:
    """The grippers, where files go, and what has been found so far."""

    environment: Path
    folder: Path
    lead: str
    follow: str
    bare: str
    lead_log: Log
    follow_log: Log
    rows: list[tuple[bool, str, str]] = field(default_factory=list)
    runtime_directory: Path | None = None
    """Where LeRobot's commands look for sockets, if elsewhere than this program does."""

    def note(self, name: str, found: str, *, good: bool) -> None:
        """Note one finding, and print it."""
        self.rows.append((good, name, found))
        print(f"{'ok ' if good else 'BAD'}  {name:<44} {found}", flush=True)

    def start(self, program: str, *arguments: str) -> subprocess.Popen[str]:
        """Start one of LeRobot's commands."""
        kept = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        kept.pop("PYTHONDONTWRITEBYTECODE", None)  # else 5 GB are compiled at each start
        if self.runtime_directory is not None:
            kept["XDG_RUNTIME_DIR"] = str(self.runtime_directory)
        return subprocess.Popen(
            [str(self.environment / "bin" / program), *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=self.folder,
            env={**kept, "HF_HUB_OFFLINE": "1", "HF_HOME": str(self.folder / "hf")},
        )

    def run(self, program: str, *arguments: str, says: str = "") -> tuple[int, str]:
        """Run one of LeRobot's commands; return its exit code and what it printed."""
        process = self.start(program, *arguments)
        try:
            output, _ = process.communicate(says, _WITHIN_S)
        finally:
            process.kill()
        return process.returncode, output

    def ended_well(self, name: str, code: int, output: str) -> None:
        """Note how a command ended; raise `RuntimeError` with what it printed if not well."""
        self.note(name, f"exit code {code}", good=code == 0)
        if code != 0:
            raise RuntimeError(output[-3000:])

    def robot(self, **more: object) -> list[str]:
        """Return the follower's arguments."""
        return _arguments("robot", {"type": "litegrip_follower", "channel": self.follow, **more})

    def leader(self, **more: object) -> list[str]:
        """Return the leader's arguments."""
        return _arguments("teleop", {"type": "litegrip_leader", "channel": self.lead, **more})

    def record(
        self, name: str, *arguments: str, episodes: int = 1, fps: int = FPS, video: bool = False
    ) -> tuple[int, str]:
        """Record a data set of short episodes."""
        return self.run(
            "lerobot-record",
            *arguments,
            f"--dataset.repo_id=me/{name}",
            f"--dataset.root={self.folder / name}",
            "--dataset.single_task=sweep",
            f"--dataset.num_episodes={episodes}",
            "--dataset.episode_time_s=9",
            "--dataset.reset_time_s=1",
            f"--dataset.fps={fps}",
            f"--dataset.video={str(video).lower()}",
            "--dataset.push_to_hub=false",
            "--play_sounds=false",
        )

    def read(self, name: str, pictures: Path | None = None) -> dict[str, Any]:
        """Read a data set with LeRobot, which also writes its images to a folder."""
        arguments = [f"me/{name}", str(self.folder / name), *([str(pictures)] if pictures else [])]
        process = self.start("python", str(HERE / "read_dataset.py"), *arguments)
        output, _ = process.communicate(timeout=_WITHIN_S)
        found: dict[str, Any] = json.loads(output[output.index('{"names"') :])
        return found


def _arguments(of: str, settings: dict[str, object]) -> list[str]:
    return [f"--{of}.{name}={value}" for name, value in settings.items()]


def column(data: dict[str, Any], of: str, name: str) -> list[float]:
    """Return one figure of all frames."""
    index = data["names"]["action" if of == "action" else "observation.state"].index(name)
    return [frame[of][index] for frame in data["frames"]]


def check_frames(trial: Trial, what: str, output: str, data: dict[str, Any], above: float) -> None:
    """Compare a data set with the logs of both daemons."""
    zero_s = dict(_ZERO.findall(output))
    times_s = [
        float(zero_s[trial.follow]) + one for one in column(data, "observation", "gripper.stamp_s")
    ]
    trial.follow_log.until(times_s[-1] + 0.5)
    trial.lead_log.until(times_s[-1] + 0.5)
    follower, leader = trial.follow_log.track(), trial.lead_log.track()
    steps_s = [after - before for before, after in pairwise(times_s)]
    trial.note(
        f"{what}: frames, stamps rise",
        f"{len(times_s)} frames; steps {min(steps_s) * 1e3:.1f} to {max(steps_s) * 1e3:.0f} ms",
        good=min(steps_s) > 0.0,
    )
    late_s = [
        at_s - times_s[0] - frame["timestamp"]
        for at_s, frame in zip(times_s, data["frames"], strict=True)
        if frame["episode"] == 0
    ]
    trial.note(
        f"{what}: LeRobot's own timestamp is off by",
        f"{min(late_s) * 1e3:.0f} to {max(late_s) * 1e3:.0f} ms in episode 0",
        good=True,
    )
    seen = column(data, "observation", "gripper.pos")
    off = [abs(pos / 100.0 - follower.at(t)) for t, pos in zip(times_s, seen, strict=True)]
    trial.note(
        f"{what}: position at its own stamp",
        f"off by {max(off) * 100.0:.3f} % of the travel at most",
        good=max(off) <= MOST_OFF,
    )
    # The action is read between an observation and the next one: within a period if that is.
    actions = column(data, "action", "gripper.pos")
    counted = [frame for frame, step_s in enumerate(steps_s) if step_s <= 1.1 / FPS]
    outside = 0.0
    for frame in counted:
        pos, at_s = actions[frame] / 100.0, times_s[frame]
        least, most = leader.range(at_s - 1.0 / FPS, at_s + 1.0 / FPS)
        outside = max(outside, least - pos, pos - most)
    trial.note(
        f"{what}: leader's action within one period",
        f"outside by {outside * 100.0:.3f} % at most; {len(counted)} of {len(actions)} frames",
        good=outside <= MOST_OFF and len(counted) > 0.5 * len(actions),
    )
    ends_s = max(
        t for t, frame in zip(times_s, data["frames"], strict=True) if not frame["episode"]
    )
    check_lag(trial, what, leader, follower, times_s[0] + 1.0, ends_s, above)


def check_lag(
    trial: Trial,
    what: str,
    leader: Track,
    follower: Track,
    from_s: float,
    to_s: float,
    above: float = 0.0,
) -> None:
    """Say how far the follower is behind the hand."""
    found = sweeps(leader, follower, from_s, to_s, SWEEP_S, above)
    shown = ", ".join(
        f"{one.late_s * 1e3:.0f} ms at {one.fastest_s * TRAVEL_MM:.0f} mm/s" for one in found
    )
    # On a busy machine the simulated hand stands still, too, and then makes up for it.
    calm_s = [one.late_s for one in found if one.fastest_s * TRAVEL_MM <= FASTEST_CALM_MM_S]
    most_s = MOST_LAG_S if trial.runtime_directory is None else MOST_LAG_BY_PORTAL_S
    trial.note(
        f"{what}: follower's lag, at 66 mm/s",
        f"{median(calm_s) * 1e3:.0f} ms; {shown}" if calm_s else f"no calm sweep; {shown}",
        good=bool(calm_s) and median(calm_s) <= most_s,
    )


def record_and_replay(trial: Trial, name: str = "stream") -> None:
    """Record two episodes by LeRobot's loop, and replay the first."""
    code, output = trial.record(name, *trial.robot(), *trial.leader(), episodes=2)
    trial.ended_well(f"lerobot-record, {name}", code, output)
    data = trial.read(name)
    check_frames(trial, name, output, data, 0.0)
    wanted = [
        (frame["timestamp"], frame["action"][0] / 100.0)
        for frame in data["frames"]
        if frame["episode"] == 0
    ]
    move(trial.follow_log.channel, wanted[0][1])
    code, output = trial.run(
        "lerobot-replay",
        *trial.robot(),
        f"--dataset.repo_id=me/{name}",
        f"--dataset.root={trial.folder / name}",
        "--dataset.episode=0",
        "--play_sounds=false",
    )
    trial.ended_well(f"lerobot-replay, {name}", code, output)
    begun_s = float(dict(_ZERO.findall(output))[trial.follow])
    trial.follow_log.until(begun_s + wanted[-1][0] + 6.0)
    begun = [(begun_s + at_s, value) for at_s, value in wanted]
    off, late_s = drifting(begun, trial.follow_log.track())
    shown = ", ".join(f"{one * 1e3:.0f}" for one in late_s)
    trial.note(
        f"{name}, replayed: RMS",
        f"{off * 100.0:.2f} % of the travel; LeRobot's loop is late by, each second: {shown} ms",
        good=off <= MOST_REPLAY_RMS,
    )


def through_a_portal(trial: Trial) -> None:
    """Do the same by a fleet: LeRobot meets both grippers by the names that its portal has."""
    certificates = make_certificates(
        trial.folder / "certificates", HOST, "user:op1", "gateway:robot1"
    )
    sockets = {}
    for name, channel in (("lead", trial.lead), ("follow", trial.follow)):
        with LiteGrip(channel) as gripper:
            sockets[name] = Path(str(gripper.socket_path))
    with fleet(trial.folder / "fleet", certificates, sockets) as lab:
        there = replace(
            trial,
            lead=f"{SITE}.lead",
            follow=f"{SITE}.follow",
            runtime_directory=lab.runtime_directory(),
        )
        record_and_replay(there, "portal")


def teleoperate_and_hang(trial: Trial) -> None:
    """Teleoperate at 60 Hz; then LeRobot hangs, goes on, and is killed."""
    process = trial.start("lerobot-teleoperate", *trial.robot(), *trial.leader(), "--fps=60")
    try:
        zero_s = _wait_until_it_begins(process, 2)
        begun_s = float(zero_s[trial.follow])
        trial.follow_log.until(begun_s + 8.0)
        trial.lead_log.until(begun_s + 8.0)
        check_lag(
            trial,
            "teleoperate",
            trial.lead_log.track(),
            trial.follow_log.track(),
            begun_s + 1.0,
            begun_s + 7.6,
        )
        process.send_signal(signal.SIGSTOP)
        hung_s = time.monotonic()
        trial.follow_log.until(hung_s + 1.5)
        process.send_signal(signal.SIGCONT)
        least, most = trial.follow_log.track().range(hung_s + 0.5, hung_s + 1.4)
        held = [
            row for row in trial.follow_log.rows if hung_s + 0.5 < row["feedback_s"] < hung_s + 1.4
        ]
        modes = {(row["mode"], row["enabled"]) for row in held}
        trial.note(
            "a policy that hangs: the jaws hold",
            f"they moved {(most - least) * TRAVEL_MM:.2f} mm from 0.5 to 1.4 s; {modes}",
            good=(most - least) * TRAVEL_MM < 0.5 and modes == {("holding", True)},
        )
        trial.follow_log.until(hung_s + 5.0)
        trial.lead_log.until(hung_s + 5.0)
        late_s, off = delay_s(
            [
                (
                    hung_s + 2.5 + 0.01 * index,
                    trial.lead_log.track().at(hung_s + 2.5 + 0.01 * index),
                )
                for index in range(200)
            ],
            trial.follow_log.track(),
        )
        trial.note(
            "and follow again when it goes on",
            f"1 s later {late_s * 1e3:.0f} ms behind, {off * 100.0:.1f} % off",
            good=off < MOST_REPLAY_RMS,
        )
    finally:
        process.kill()
        process.communicate()
    killed_s = time.monotonic()
    trial.follow_log.until(killed_s + 1.0)
    trial.note(
        "killed: the motor is disabled",
        f"mode {trial.follow_log.rows[-1]['mode']}",
        good=trial.follow_log.rows[-1]["enabled"] is False,
    )


def _wait_until_it_begins(process: subprocess.Popen[str], count: int) -> dict[str, str]:
    """Read what a command prints until so many grippers have begun."""
    found: dict[str, str] = {}
    assert process.stdout is not None
    said = []
    for line in process.stdout:
        said.append(line)
        found.update(_ZERO.findall(line))
        if len(found) == count:
            os.set_blocking(process.stdout.fileno(), False)
            return found
    raise RuntimeError("".join(said))


def by_the_daemons(trial: Trial) -> None:
    """Record while the daemons teleoperate, with something between the follower's jaws."""
    move(trial.follow, 0.8)
    simulated(trial.follow, "sim.object", width_mm=30.0, stiffness_nm_rad=250.0, slip_mm_s=0.0)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: dict[str, object] = {"mode": "daemon", "teleop_port": probe.getsockname()[1]}
    felt: list[float] = []
    with LiteGrip(trial.lead) as watching:
        process = trial.start(
            "lerobot-record",
            *trial.robot(**port, leader_host="127.0.0.1"),
            *trial.leader(**port),
            "--dataset.repo_id=me/daemon",
            f"--dataset.root={trial.folder / 'daemon'}",
            "--dataset.single_task=sweep",
            "--dataset.num_episodes=1",
            "--dataset.episode_time_s=9",
            "--dataset.fps=30",
            "--dataset.video=false",
            "--dataset.push_to_hub=false",
            "--play_sounds=false",
        )
        while process.poll() is None:
            felt.append(watching.teleop_status()["reflected_n"] or 0.0)
            time.sleep(0.05)
        output = process.communicate()[0]
    trial.ended_well("lerobot-record, mode daemon", process.returncode, output)
    data = trial.read("daemon")
    check_frames(trial, "daemon", output, data, 0.45)
    held = column(data, "observation", "gripper.grasped")
    trial.note(
        "daemon: what is gripped is recorded, and felt",
        f"gripped in {sum(held):.0f} of {len(held)} frames; {max(felt):.1f} N at the leader",
        good=0 < sum(held) < len(held) and max(felt) > 0.5,
    )
    simulated(trial.follow, "sim.reset")


def with_an_arm(trial: Trial) -> None:
    """Record and replay an arm with this gripper and a camera."""
    robot = trial.robot(type="litegrip_with_arm", arm="{type: trial_arm, port: nowhere}")
    camera = "--robot.cameras={front: {type: trial_camera, width: 64, height: 48, fps: 30}}"
    leader = trial.leader(type="litegrip_leader_with_arm", arm="{type: trial_arm_leader}")
    code, output = trial.record("arm", *robot, camera, *leader)
    trial.ended_well("lerobot-record, an arm with the gripper", code, output)
    data = trial.read("arm")
    check_frames(trial, "arm", output, data, 0.0)
    names = data["names"]["action"]
    trial.note(
        "arm: its own gripper is left out",
        ", ".join(names),
        good=sorted(names) == ["elbow.pos", "gripper.pos", "gripper.torque", "shoulder.pos"],
    )
    images = [next(iter(frame["images"].values())) for frame in data["frames"]]
    shades = {shade for *_, shade in images}
    trial.note(
        "arm: images",
        f"{images[0][:3]}, {len(shades)} different ones",
        good=images[0][:3] == [3, 48, 64] and len(shades) > FPS,
    )
    code, output = trial.run(
        "lerobot-replay",
        *robot,
        camera,
        "--dataset.repo_id=me/arm",
        f"--dataset.root={trial.folder / 'arm'}",
        "--dataset.episode=0",
        "--play_sounds=false",
    )
    trial.ended_well("lerobot-replay, an arm with the gripper", code, output)


def with_images(trial: Trial) -> None:
    """Record what the camera of MuJoCo's scene sees, as images and as a video."""
    with daemon(trial.folder, "scene", mechanics=ON_MUJOCO) as channel:
        with LiteGrip(channel) as gripper:
            travel_mm = float(gripper.info()["gripper"]["travel_mm"])
        camera = (
            f"{{type: litegrip_scene, channel: {channel},"
            f" width: {IMAGE[0]}, height: {IMAGE[1]}, fps: {IMAGES_A_SECOND}}}"
        )
        for name, video in (("images", False), ("video", True)):
            code, output = trial.record(
                name,
                *trial.robot(channel=channel, cameras=f"{{front: {camera}}}"),
                *trial.leader(),
                fps=IMAGES_A_SECOND,
                video=video,
            )
            trial.ended_well(f"lerobot-record, {name} of MuJoCo's scene", code, output)
            check_images(trial, name, travel_mm)


def check_images(trial: Trial, name: str, travel_mm: float) -> None:
    """Compare how far the jaws are open in each image with the position beside it."""
    folder = trial.folder / f"{name}-pictures"
    data = trial.read(name, folder)
    frames = data["frames"]
    shapes = {tuple(shape[:3]) for frame in frames for shape in frame["images"].values()}
    trial.note(
        f"{name}: frames",
        f"{len(frames)} of 9 s at {IMAGES_A_SECOND} a second, {shapes}",
        good=len(frames) >= 0.8 * 9 * IMAGES_A_SECOND and shapes == {(3, *IMAGE[::-1])},
    )
    opened_mm = [pos / 100.0 * travel_mm for pos in column(data, "observation", "gripper.pos")]
    off_px = []
    for index, opening_mm in enumerate(opened_mm):
        with Image.open(folder / f"{index:04}.png") as image:
            row = image.convert("L").crop((0, ROW_PX, IMAGE[0], ROW_PX + 1)).tobytes()
        seen = seen_px(row)
        off_px.append(math.inf if seen is None else seen - expected_px(opening_mm, IMAGE[1]))
    trial.note(
        f"{name}: the jaws' opening in the image",
        f"{min(opened_mm):.0f} to {max(opened_mm):.0f} mm, a px is"
        f" {1.0 / expected_px(1.0, IMAGE[1]):.2f} mm; off by {median(map(abs, off_px)):.1f} px,"
        f" at most {max(map(abs, off_px)):.1f} px",
        good=max(map(abs, off_px)) <= MOST_PX_OFF and max(opened_mm) - min(opened_mm) > 25.0,
    )
    held = column(data, "observation", "gripper.grasped")
    trial.note(
        f"{name}: the cube is held in some",
        f"{sum(held):.0f} of {len(held)} frames; {min(opened_mm):.1f} mm at least",
        good=0 < sum(held) < len(held) and abs(min(opened_mm) - 30.0) < 1.0,
    )
    sheet(folder, opened_mm, held).save(trial.environment / f"{name}.png")


def sheet(folder: Path, opened_mm: list[float], held: list[float]) -> Image.Image:
    """Return four images of a data set beside each other, from open jaws to the cube held.

    That of `images` is the picture of docs/mujoco.md.
    """
    last = held.index(1.0)
    first = max(range(last), key=opened_mm.__getitem__)
    drawn = Image.new("RGB", (4 * IMAGE[0] + 9, IMAGE[1] + 24), "white")
    words = ImageDraw.Draw(drawn)
    for place in range(4):
        index = round(first + (last - first) * place / 3)
        with Image.open(folder / f"{index:04}.png") as image:
            drawn.paste(image, (place * (IMAGE[0] + 3), 0))
        said = f"frame {index}: {opened_mm[index]:.1f} mm" + (", held" if held[index] else "")
        words.text((place * (IMAGE[0] + 3) + 8, IMAGE[1] + 6), said, fill="black", font_size=13)
    return drawn


def refusals(trial: Trial) -> None:
    """See what is refused, and how it is said."""
    with LiteGrip(trial.follow) as other, other.lease("sorting"):
        code, output = trial.record("leased", *trial.robot(), *trial.leader())
    _refused(trial, "another program has the lease", code, output, r"LeaseError: .*lease")
    _ended_by(trial, "a stop", "StoppedError: gripper .* is stopped", _stop)
    with LiteGrip(trial.follow) as gripper:
        gripper.clear_stop()
    _ended_by(
        trial,
        "a motor that falls silent",
        "StaleFiguresError: .*silent",
        lambda: simulated(trial.follow, "sim.fault", name="silent"),
    )
    simulated(trial.follow, "sim.reset")
    code, output = trial.run(
        "lerobot-teleoperate",
        *trial.robot(channel=trial.bare),
        *trial.leader(),
        "--teleop_time_s=2",
    )
    _refused(trial, "not calibrated, nobody to ask", code, output, "a calibration asks before it")
    mode = trial.robot(mode="daemon")
    code, output = trial.run("lerobot-teleoperate", *mode, *trial.leader())
    _refused(trial, 'mode "daemon" without a leader', code, output, "needs leader_host")


def _stop(trial: Trial) -> None:
    with LiteGrip(trial.follow) as gripper:
        gripper.software_stop("hold", "lunch")


def calibrations(trial: Trial) -> None:
    """See that a calibration asks, and what each answer does."""
    log = Log(trial.bare)
    bare = trial.robot(channel=trial.bare, mount="normal")
    for answer, moves in (("\n", False), ("85\n", True)):
        before = len(log.rows)
        code, output = trial.run("lerobot-calibrate", *bare, says=answer)
        log.until(time.monotonic())
        modes = {row["mode"] for row in log.rows[before:]}
        with LiteGrip(trial.bare) as gripper:
            calibrated = gripper.get_state().calibrated
        trial.note(
            f"lerobot-calibrate, answer {answer!r}",
            f"exit code {code}; calibrated {calibrated}; modes {sorted(modes)}",
            good=code == 0 and calibrated is moves and ("moving" in modes) is moves,
        )
        if code != 0:
            raise RuntimeError(output[-3000:])
    log.close()


def _ended_by(trial: Trial, name: str, says: str, happens: Callable[..., object]) -> None:
    """See that something ends a teleoperation, and what is said of it."""
    process = trial.start("lerobot-teleoperate", *trial.robot(), *trial.leader(), "--fps=30")
    begun_s = float(_wait_until_it_begins(process, 2)[trial.follow])
    trial.follow_log.until(begun_s + 1.0)
    happens(trial) if happens is _stop else happens()
    assert process.stdout is not None
    os.set_blocking(process.stdout.fileno(), True)
    output = process.communicate(timeout=_WITHIN_S)[0]
    _refused(trial, name, process.returncode, output, says)


def _refused(trial: Trial, name: str, code: int, output: str, says: str) -> None:
    found = re.search(says + ".*", output)
    trial.note(
        f"refused: {name}",
        f"exit code {code}; {found.group(0)[:110] if found else output[-1500:]}",
        good=code not in {0, -9} and found is not None,
    )


SCENES: dict[str, Callable[[Trial], None]] = {
    "stream": record_and_replay,
    "portal": through_a_portal,
    "teleoperate": teleoperate_and_hang,
    "daemon": by_the_daemons,
    "arm": with_an_arm,
    "images": with_images,
    "refusals": refusals,
    "calibrate": calibrations,
}


def main(environment: str, scenes: list[str]) -> int:
    """Play the scenes; return the exit code."""
    with (
        tempfile.TemporaryDirectory(prefix="litegrip-lerobot-") as name,
        daemon(Path(name), "lead", by_hand=True) as lead,
        daemon(Path(name), "follow") as follow,
        daemon(Path(name), "bare", calibrated=False) as bare,
    ):
        logs = Log(lead), Log(follow)
        trial = Trial(Path(environment).absolute(), Path(name), lead, follow, bare, *logs)
        for scene, play in SCENES.items():
            if not scenes or scene in scenes:
                play(trial)
        for log in logs:
            log.close()
    load = ", ".join(f"{one:.1f}" for one in os.getloadavg())
    bad = [name for good, name, _ in trial.rows if not good]
    print(f"{len(trial.rows)} findings, {len(bad)} bad; load {load} on {os.cpu_count()} processors")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2:]))
