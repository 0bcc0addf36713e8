"""The cases of the checks of the gripper: the bus as the daemon has it, motor and calibration."""

from dataclasses import replace

from litegrip_client.ctl.doctor.facts import Configuration, Scan
from tests.client.doctor.case import Case, Cases
from tests.client.doctor.known import FILE, NOW_S, daemon, facts, with_daemon

ZERO = "litegripctl -c can0 enable && litegripctl -c can0 zero"

RESTS = {"foreign_commands": 0, "foreign_active": False, "in_use": False}
ASKED = tuple(range(1, 17))

GRIPPER_CASES: Cases = {
    "bus": [
        Case(facts(), "OK the daemon uses it, load 12%, 0 lost frames"),
        Case(
            with_daemon(health_bus={"state": "bus_stalled", "error": "x"}, health_motor=RESTS),
            "WARNING nobody on it acknowledges a frame # 24 V",
        ),
        Case(
            with_daemon(health_bus={"state": "adapter_gone", "error": "x"}, health_motor=RESTS),
            "ERROR the daemon cannot use it (adapter_gone) # found above",
        ),
        Case(with_daemon(health_bus__load=0.79), "OK load 79%"),
        Case(
            with_daemon(health_bus__load=0.97),
            "WARNING load 97%, 0 lost frames: somebody fills it, and commands come late"
            " $ candump can0"
            " # a bus of its own",
        ),
        Case(with_daemon(health_bus__reopened=2, health_uptime_s=60.0), "OK"),
        Case(with_daemon(health_bus__reopened=9, health_uptime_s=36_001.0), "OK"),
        Case(
            with_daemon(health_bus__reopened=500, health_uptime_s=86_400.0),
            "WARNING 0 lost frames; it was lost and opened again 500 times in 24.0 h"
            " $ sudo dmesg | tail"
            " # a loose plug, cable or hub",
        ),
    ],
    "motor": [
        Case(
            with_daemon(state_status="communication_lost", health_motor=RESTS),
            "OK disabled, last feedback 0.004 s ago: 'communication lost' is normal after a second",
        ),
        Case(
            with_daemon(state_status="under_voltage", health_motor=RESTS),
            "WARNING disabled, last feedback 0.004 s ago: its power stage has, or had, no supply"
            " # 24 V",
        ),
        Case(
            with_daemon(
                state_motor="silent", state_stale=True, state_age_s=7.25, health_motor=RESTS
            ),
            "WARNING silent, last feedback 7.250 s ago: it does not answer, which is normal"
            " while its power"
            " # 0x08",
        ),
        Case(facts(), "OK disabled, last feedback 0.004 s ago"),
        Case(with_daemon(health_bus__state="down")),
        Case(
            with_daemon(state_motor="silent", state_stale=True, state_age_s=7.25),
            "ERROR silent, last feedback 7.250 s ago # 0x08",
        ),
        Case(
            with_daemon(
                state_motor="unknown", state_stale=True, state_age_s=None, hello_motor={"can_id": 9}
            ),
            "ERROR unknown, no feedback yet # 0x09",
        ),
        Case(
            with_daemon(state_motor="fault", state_status="coil_hot"),
            "ERROR it reports a fault: coil_hot, last feedback 0.004 s ago"
            " # let it cool down, and look at what it holds; then: litegripctl -c can0 enable",
        ),
        Case(
            with_daemon(state_motor="fault", state_status="overload"),
            "ERROR it reports a fault: overload, last feedback 0.004 s ago"
            " $ litegripctl -c can0 enable"
            " # find its cause",
        ),
        Case(
            with_daemon(state_motor="fault", state_status="communication_lost"),
            "ERROR it reports a fault: communication_lost, last feedback 0.004 s ago"
            " $ litegripctl -c can0 enable"
            " # the line health says if the bus or the daemon itself was silent",
        ),
    ],
    "stop": [
        Case(
            with_daemon(state_stop={"level": "hold", "by": "pick.py", "why": "a hand"}),
            "WARNING a stop of pick.py is latched, and motions are refused: a hand"
            " $ litegripctl -c can0 clear"
            " # when it is safe",
        ),
        Case(
            with_daemon(state_stop={"level": "hold", "by": "pick.py", "why": None}),
            "WARNING a stop of pick.py is latched, and motions are refused"
            " $ litegripctl -c can0 clear"
            " # when it is safe",
        ),
    ],
    "scan": [
        Case(facts(scan=Scan(ASKED, {8: 24})), "OK motors answer at: 0x08 (answers on 0x18)"),
        Case(
            facts(scan=Scan(ASKED, {8: 24, 9: 25})),
            "OK 0x09 (answers on 0x19); a gripper has one motor: others are not its",
        ),
        Case(
            facts(
                scan=Scan(ASKED, {9: 25}), daemon=daemon(info_configuration__file="/etc/mine.toml")
            ),
            "ERROR nothing answers at 0x08, but motors do at: 0x09 (answers on 0x19)"
            " $ sudo systemctl restart litegripd@can0"
            " # first set [motor] can_id = 0x09 in /etc/mine.toml",
        ),
        Case(
            facts(scan=Scan(problem="the motor is enabled"), daemon=daemon(state_enabled=True)),
            "ERROR no id was asked: the motor is enabled"
            " $ litegripctl -c can0 disable"
            " # then again: litegripctl -c can0 doctor --scan",
        ),
    ],
    "other-master": [
        Case(facts(), "OK nobody but the daemon"),
        Case(
            with_daemon(health_motor={"foreign_commands": 3, "foreign_active": True}),
            "ERROR another program has sent the motor 3 frames, and continues: a second master"
            " $ candump can0"
            " # let it use the daemon",
        ),
        Case(
            with_daemon(health_motor={"foreign_commands": 3}),
            "ERROR a second master $ candump can0 # let it use the daemon",
        ),
        Case(
            replace(
                with_daemon(health_motor={"foreign_commands": 3, "foreign_active": True}),
                interface="slcan",
            ),
            "ERROR a second master # let it use the daemon",
        ),
        Case(
            with_daemon(health_motor={"foreign_commands": 3, "foreign_active": False}),
            "WARNING another program has sent the motor 3 frames since the daemon was"
            " started; it is quiet now"
            " # motions are refused",
        ),
    ],
    "control-mode": [
        Case(facts(), "OK CTRL_MODE 1, MIT"),
    ],
    "can-br": [
        Case(facts(), "OK can_br 4, 1 Mbit/s"),
        Case(with_daemon(info_registers__can_br=None)),
    ],
    "ids": [
        Case(facts(), "OK commanded by 0x08, answers on 0x18"),
        Case(
            with_daemon(info_registers__ESC_ID=9),
            "ERROR but its ESC_ID is 0x09 # set [motor] can_id = 0x09",
        ),
        Case(
            with_daemon(info_registers__MST_ID=8),
            "ERROR cannot be told apart # set register 7 (MST_ID) to 0x18",
        ),
    ],
    "watchdog": [
        Case(facts(), "OK TIMEOUT 2000, on; by it the motor lets go 100 ms after a loss"),
        Case(with_daemon(info_registers__TIMEOUT=8000), "OK 400 ms"),
        Case(
            with_daemon(info_registers__TIMEOUT=20_000),
            "WARNING TIMEOUT is 1 s after power-on # set register 9 to 2000",
        ),
    ],
    "ranges": [
        Case(facts(), "OK PMAX 12.5, VMAX 30, TMAX 10, the model's"),
        Case(
            with_daemon(info_registers__PMAX=3.141593),
            "WARNING PMAX 3.14159, VMAX 30, TMAX 10 instead of the model's 12.5, 30, 10"
            " # nothing to do",
        ),
    ],
    "calibration": [
        Case(
            facts(),
            "OK mount normal, travel 87.0 mm, open goes to 80 mm, 3 days old, /var/lib/lite",
        ),
        Case(
            with_daemon(info_calibration__file=None),
            "WARNING in no file: lost at a restart $ litegripctl -c can0 calibration save",
        ),
        Case(with_daemon(info_calibration__nominal=True), f"WARNING nominal: it was not $ {ZERO}"),
        Case(with_daemon(info_calibration=None), "OK of unknown date, /var/lib/litegripd"),
        Case(with_daemon(info_calibration__saved_s=1.8e9), "OK of today"),
        Case(
            with_daemon(info_calibration__saved_s=NOW_S + 400 * 86_400.0),
            "OK dated 400 days ahead of this machine's clock",
        ),
        Case(
            with_daemon(
                hello_gripper={"calibrated": False},
                info_calibration__problem="no calibration: /c.json: Permission denied",
            ),
            "ERROR none, and motions are refused: no calibration: /c.json: Permission denied"
            " # have it read again: litegripctl -c can0 calibration load --chain; or measure",
        ),
        Case(with_daemon(info_configuration__gripper={"calibration": FILE}), "OK"),
        Case(
            with_daemon(info_configuration__gripper={"calibration": "/home/me/mine.json"}),
            f"WARNING {FILE}: at its next start the daemon takes /home/me/mine.json, which"
            " [gripper] mount"
            ' # to keep this one, set mount = "normal" in [gripper]',
        ),
        Case(
            with_daemon(hello_gripper__work_stroke_mm=None),
            "OK mount normal, travel 87.0 mm, 3 days old",
        ),
        Case(
            with_daemon(state_scale_doubt="superseded", hello_gripper__travel_mm=120.05),
            f"WARNING travel 120.0 mm, open goes to 80 mm, {FILE}: the scale of earlier"
            " versions, which took the travel for 120 mm; all mm are too large"
            " $ litegripctl -c can0 calibration rescale"
            " # no other measurement; if a caliper says that the jaws do not open 85 mm, add"
            " --stroke-mm",
        ),
        Case(
            with_daemon(
                state_scale_doubt="superseded",
                hello_gripper__travel_mm=120.05,
                info_calibration__nominal=True,
                info_calibration__file=None,
            ),
            "WARNING travel 120.0 mm, open goes to 80 mm: the scale of earlier versions,"
            " which took the travel"
            " $ litegripctl -c can0 calibration rescale"
            " # no other measurement; if a caliper says that the jaws do not open 85 mm, add"
            " --stroke-mm",
        ),
        Case(
            with_daemon(state_scale_doubt="unusual", hello_gripper__rad_to_mm=84.31),
            f"WARNING , {FILE}: 84.31 mm/rad, as no gripper was seen to have"
            f" $ {ZERO}"
            " # its limits are probably wrong; if a caliper says that the jaws do not open 85"
            " mm, then:",
        ),
    ],
    "stroke": [
        Case(facts(), "OK the jaws open 85 mm, as configured"),
        Case(
            with_daemon(info_configuration__gripper={"stroke_mm": 95.0}),
            "WARNING by the configuration the jaws open 95 mm, by the calibration 86.0 mm"
            " $ litegripctl -c can0 calibration rescale"
            " # if a caliper agrees with the configuration; else correct stroke_mm in [gripper]",
        ),
        Case(with_daemon(info_configuration={})),
        Case(
            with_daemon(info_configuration__gripper={"stroke_mm": 120.0}),
            "WARNING stroke_mm = 120 under [gripper] in /etc/litegripd/can0.toml is the"
            " placeholder of earlier versions, and counts as 85 mm"
            " # remove stroke_mm from /etc/litegripd/can0.toml",
        ),
        Case(
            facts(
                daemon=None,
                configuration=Configuration(
                    "/x.toml", content={"file": "/x.toml", "gripper": {"stroke_mm": 120.0}}
                ),
            ),
            "WARNING stroke_mm = 120 under [gripper] in /x.toml"
            " # set it to what a caliper measures",
        ),
    ],
    "position": [
        Case(facts(), "OK -0.500 rad, calibrated travel -1.500 to 0.100 rad"),
        Case(with_daemon(state_stale=True, state_position_rad=9.0)),
        Case(with_daemon(hello_gripper={"calibrated": False})),
        Case(with_daemon(state_position_rad=1.09), "OK"),
        Case(with_daemon(state_position_rad=-2.49), "OK"),
        Case(
            with_daemon(state_position_rad=1.11),
            "ERROR 1.110 rad, calibrated travel -1.500 to 0.100 rad: no jaw can be there"
            " # litegripctl -c can0 enable && litegripctl -c can0 zero --mount normal",
        ),
        Case(
            with_daemon(state_position_rad=-2.51),
            "ERROR no jaw can be there # power-cycle it with the jaws inside the travel",
        ),
    ],
    "channel": [
        Case(facts(), "OK the calibration is for can0"),
        Case(with_daemon(info_calibration__channel=None)),
        Case(
            with_daemon(
                info_calibration__foreign="the calibration is probably another gripper's: x"
            ),
            "WARNING the calibration is probably another gripper's: x"
            f" $ {ZERO}"
            " # look at its mount",
        ),
        Case(
            facts(
                channel="lab.left",
                daemon=daemon(hello_channel="lab.left", hello_remote={"channel": "can0"}),
            ),
            "OK the calibration is for can0",
        ),
        Case(
            with_daemon(hello_remote={"channel": "can3"}),
            f"WARNING the calibration is for can0, this is can3 $ {ZERO} # look at its mount",
        ),
        Case(
            with_daemon(info_calibration__channel="can1"),
            f"WARNING the calibration is for can1, this is can0 $ {ZERO} # look at its mount",
        ),
    ],
}
