"""The transition table as a whole."""

from itertools import product

import pytest

from litegripd.model.motor import MotorPhase
from litegripd.motor.phases import PUBLIC, TRANSITIONS, Event, Phase

ENABLING = {Phase.PREPARING, Phase.CLEARING, Phase.ARMING}


def reachable(start: Phase, events: set[Event]) -> set[Phase]:
    found, open_ends = {start}, [start]
    while open_ends:
        phase = open_ends.pop()
        for event in events:
            following = TRANSITIONS.get((phase, event))
            if following is not None and following not in found:
                found.add(following)
                open_ends.append(following)
    return found


def test_every_phase_is_reachable_from_the_first() -> None:
    assert reachable(Phase.LOOKING, set(Event)) == set(Phase)


def test_nothing_but_a_clients_request_leads_towards_enabled() -> None:
    without_request = reachable(Phase.LOOKING, set(Event) - {Event.ENABLE})
    assert without_request.isdisjoint(ENABLING | {Phase.ENABLED, Phase.LOST})


def test_enabled_is_entered_from_arming_or_after_a_silence_only() -> None:
    into = {pair for pair, following in TRANSITIONS.items() if following is Phase.ENABLED}
    assert into == {(Phase.ARMING, Event.SAW_ENABLED), (Phase.LOST, Event.SAW_ENABLED)}


def test_a_silence_is_entered_from_enabled_only() -> None:
    into = {phase for (phase, _), following in TRANSITIONS.items() if following is Phase.LOST}
    assert into == {Phase.ENABLED}


def test_arming_is_entered_only_with_the_fault_cleared_and_the_watchdog_on() -> None:
    into = {pair for pair, following in TRANSITIONS.items() if following is Phase.ARMING}
    assert into == {(Phase.CLEARING, Event.SAW_DISABLED)}
    assert {p for p in TRANSITIONS if TRANSITIONS[p] is Phase.CLEARING} == {
        (Phase.PREPARING, Event.PREPARED),
        (Phase.ARMING, Event.SAW_FAULT),
    }
    assert {p for p in TRANSITIONS if TRANSITIONS[p] is Phase.PREPARING} == {
        (Phase.DISABLED, Event.ENABLE),
        (Phase.FAULT, Event.ENABLE),
    }


@pytest.mark.parametrize("phase", Phase)
def test_disable_leads_to_disabled_when_the_motor_answers(phase: Phase) -> None:
    phase = TRANSITIONS.get((phase, Event.DISABLE), phase)
    assert phase in (Phase.DISABLING, Phase.LOOKING)
    phase = TRANSITIONS.get((phase, Event.SAW_ENABLED), phase)
    assert phase is Phase.DISABLING
    assert TRANSITIONS[phase, Event.SAW_DISABLED] is Phase.DISABLED


@pytest.mark.parametrize("phase", [Phase.ENABLED, Phase.LOST, Phase.ARMING])
def test_a_fault_never_leaves_the_motor_enabled(phase: Phase) -> None:
    assert TRANSITIONS[phase, Event.SAW_FAULT] in (Phase.FAULT, Phase.CLEARING)


@pytest.mark.parametrize("phase", [Phase.LOOKING, Phase.DISABLED, Phase.FAULT, Phase.CLEARING])
def test_a_motor_that_somebody_else_enabled_is_disabled(phase: Phase) -> None:
    assert TRANSITIONS[phase, Event.SAW_ENABLED] is Phase.DISABLING


def test_a_fault_that_is_gone_leaves_a_disabled_motor() -> None:
    for phase in (Phase.FAULT, Phase.CLEARING_FAULT, Phase.LOOKING, Phase.DISABLING):
        assert TRANSITIONS[phase, Event.SAW_DISABLED] is Phase.DISABLED


def test_a_silent_motor_is_looked_for_anew() -> None:
    for phase in (Phase.DISABLED, Phase.FAULT, Phase.DISABLING):
        assert TRANSITIONS[phase, Event.NO_ANSWER] is Phase.LOOKING
    assert TRANSITIONS[Phase.LOST, Event.GAVE_UP] is Phase.LOOKING
    assert TRANSITIONS[Phase.LOST, Event.SAW_DISABLED] is Phase.LOOKING  # it may have been off


def test_no_phase_is_a_trap() -> None:
    for phase in Phase:
        assert Phase.ENABLED in reachable(phase, set(Event))


def test_every_phase_has_a_public_name_and_only_two_count_as_powered() -> None:
    assert set(PUBLIC) == set(Phase)
    assert [p for p in Phase if PUBLIC[p] is MotorPhase.ENABLED] == [Phase.ENABLED]
    assert {p for p in Phase if PUBLIC[p] is MotorPhase.ENABLING} == ENABLING


def test_every_row_changes_something() -> None:
    assert all(pair[0] is not following for pair, following in TRANSITIONS.items())
    assert len(TRANSITIONS) < len(list(product(Phase, Event)))
