/* What a motion may be given, and why it ended wrongly: made by docs/generate.py. */

export const REPLAY_SPEEDS = [0.1, 4.0];
export const SPAN_INSET_MM = 1.0;
export const STROKE_RANGE_MM = [1.0, 1000.0];
export const TEMPLATES_RAD_TO_MM = [52.69, 74.8];

export const WHY_NOT = {
  blocked: "something stopped the jaws on their way: take it away, or let go of what is held by “Let go”; then once more",
  protected: "something was in the way, and the jaws let go of it: take it away, then once more; to hold it: “Grasp”",
  no_stop: "the jaws passed the calibrated stop and met none: measure again: “Zero …”",
  timed_out: "the jaws neither arrived nor came to rest in time: look at what moves them, and at the lamp of its health; then once more",
  wrong_width: "something is held, but not of the width that was asked for",
  motor_weak: "the motor makes less torque than is commanded: how much less, says the lamp of its health; look at its supply",
  no_object: "the jaws came to their empty end: put something between them, then “Open”, and once more",
  object_lost: "it slipped or gave way, and the jaws closed further: grasp it with more force (“Force”)",
  not_aligned: "the jaws did not get to its start: take away what is in their way",
};
