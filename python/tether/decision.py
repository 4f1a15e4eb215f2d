"""Decisions that a law may return, checked before anything is sent: what the vehicle would take no notice of is an error."""

import dataclasses
import reprlib

from .messages import message_type

_MOST = message_type("plan_t").constants["MAX_COUNT"]
_LONGEST_S = 600.0  # longest plan, from its first twist's start to its last one's end
_BELOW = 1e9  # bound of any number
_WANTED = "a pair (v_mps, omega_radps) of finite numbers, a tether.Plan or None is wanted"


@dataclasses.dataclass
class Plan:
    """The twists of the coming time: each is in force for step_s (to the microsecond, above 0), the first
    from start_s on (seconds of the run). 1 to 4000 of them, over ten minutes at most."""

    start_s: float
    step_s: float
    v_mps: list
    omega_radps: list


def checked(decision, name):
    """The same with floats: None, a Plan or a pair. ValueError names the law and what is wanted."""
    if decision is None:
        return None
    if isinstance(decision, Plan):
        return _checked_plan(decision, name)
    try:
        if isinstance(decision, (dict, set)):
            raise TypeError
        v_mps, omega_radps = map(_number, decision)
    except _NOT:
        raise ValueError(f"{name} returned {_shown(decision)}; {_WANTED}") from None
    return v_mps, omega_radps


def _checked_plan(plan, name):
    def field(of, take, wanted):
        value = getattr(plan, of)
        try:
            return take(value)
        except _NOT:
            raise ValueError(f"{name} returned a Plan with {of} = {_shown(value)}; {wanted}") from None

    many = f"1 to {_MOST} finite numbers are wanted"
    start_s = field("start_s", _number, "seconds of the run are wanted")
    v_mps, omega_radps = field("v_mps", _numbers, many), field("omega_radps", _numbers, many)
    if len(v_mps) != len(omega_radps):
        counts = f"{len(v_mps)} v_mps and {len(omega_radps)} omega_radps"
        raise ValueError(f"{name} returned a Plan with {counts}; as many of both are wanted")
    longest_s = _LONGEST_S / len(v_mps)

    def step(value):
        if not 1e-6 <= _number(value) <= longest_s:
            raise ValueError
        return float(value)

    step_s = field("step_s", step, f"0.000001 to {longest_s:g} seconds are wanted")
    return Plan(start_s, step_s, v_mps, omega_radps)


_NOT = (TypeError, ValueError, OverflowError)  # raised by the three below for other values


def _number(value):
    """Whatever has the meaning of a number, numpy's too; no texts."""
    if not (abs(value) < _BELOW):
        raise ValueError
    return float(value)


def _numbers(values):
    numbers = [_number(value) for value in values]
    if not 1 <= len(numbers) <= _MOST:
        raise ValueError
    return numbers


def _shown(value):
    try:
        return reprlib.repr(value)
    except ValueError:  # a whole number of too many digits to be written
        return f"a {type(value).__name__}"
