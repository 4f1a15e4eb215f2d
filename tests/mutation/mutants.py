"""The mutants: each takes one safety rule out of one source file of can_bridge/.

(name, program, file, old, new): `old` must occur exactly once in the file. `program` is the test
program that has to notice.
"""

SAFETY = "can_safety_test"
NODE = "can_bridge_node_test"


def _obstacle(name, condition):
    """Arming goes on in spite of `condition`."""
    return (f"arming: {name}", SAFETY, "safety_requests.cpp", f"if ({condition})",
            f"if (false && ({condition}))")


MUTANTS = [
    # Freshness of commands
    ("freshness: stale commands are followed", SAFETY, "safety_core.cpp",
     "if (age < config_.stale) {", "if (true) {"),
    ("freshness: never disarms", SAFETY, "safety_core.cpp",
     "} else if (age < config_.disarm) {", "} else if (true) {"),
    ("freshness: the network's delay does not count", SAFETY, "command_watch.cpp",
     "as_of_ = std::min(stamp, now);", "as_of_ = now;"),
    ("freshness: a stamp ahead stays fresh longer", SAFETY, "command_watch.cpp",
     "as_of_ = std::min(stamp, now);", "as_of_ = stamp;"),
    ("freshness: rejected commands refresh", SAFETY, "command_watch.cpp",
     "++non_finite_;", "++non_finite_; as_of_ = now;"),
    ("input: duplicated, late and future commands", SAFETY, "command_watch.cpp",
     "if (!guard_.accept(now, stamp, seq)) return false;", "guard_.accept(now, stamp, seq);"),
    ("input: numbers that are not finite", SAFETY, "command_watch.cpp",
     "if (!is_usable(twist)) {", "if (false) {"),
    ("own loop: a gap goes unnoticed", SAFETY, "safety_core.cpp",
     "if (last_cycle_ && now - *last_cycle_ > config_.disarm) {", "if (false) {"),

    # Requests
    ("requests: old ones act", SAFETY, "request_guard.cpp", "now - stamp <= kFresh", "true"),
    ("requests: each acts more than once", SAFETY, "request_guard.cpp",
     "fresh && guard_.accept(now, stamp, seq)", "fresh"),
    ("requests: stamps of the future", SAFETY, "request_guard.cpp",
     "guard_.accept(now, stamp, seq)", "guard_.accept(stamp > now ? stamp : now, stamp, seq)"),
    ("requests: stay pending", SAFETY, "safety_core.cpp", "requests_.clear();", ""),
    ("requests: a late e-stop is ignored", SAFETY, "request_guard.cpp",
     "accepted || wanted == DriveRequest::estop", "accepted"),

    # Arming
    _obstacle("e-stop latched", "estop_latched_"),
    _obstacle("fault latched", "fault_latched_"),
    _obstacle("leaving", "leaving_since_"),
    _obstacle("together with a reset", "action_ != Decision::Action::none"),
    _obstacle("bus not up", "bus != CanState::up"),
    _obstacle("drives not in standby", "drives.phase != DrivePhase::standby"),
    _obstacle("no feedback", "!drives.feedback_fresh"),
    _obstacle("wheels turning", "!drives.standstill"),
    _obstacle("stale command", "*age >= config_.stale"),
    _obstacle("command not zero", "!commands_.is_zero()"),
    ("arming: without any command", SAFETY, "safety_requests.cpp",
     "const auto age = commands_.age(now);",
     "const std::optional<Duration> age = commands_.age(now).value_or(Duration{0});"),
    ("arming: tiny is large", SAFETY, "command_watch.cpp", "kTiny_mps = 1e-3", "kTiny_mps = 1.0"),

    # Latches
    ("latch: faults do not", SAFETY, "safety_core.cpp",
     "fault_latched_ = true;", "fault_latched_ = false;"),
    ("latch: the e-stop does not", SAFETY, "safety_requests.cpp", "estop_latched_ = true;", ""),
    ("latch: releasing the e-stop unlatches", SAFETY, "safety_requests.cpp",
     "estop_pressed_ = false;", "estop_pressed_ = estop_latched_ = false;"),
    ("latch: reset while the e-stop is pressed", SAFETY, "safety_requests.cpp",
     "} else if (estop_pressed_) {", "} else if (false) {"),
    ("latch: reset while still stopping", SAFETY, "safety_requests.cpp",
     "if (motion_ != Motion::idle) {\n    notice_ =", "if (false) {\n    notice_ ="),
    ("latch: reset arms", SAFETY, "safety_requests.cpp",
     "estop_latched_ = false;", "estop_latched_ = false;\n  motion_ = Motion::enabling;"),
    ("latch: does not stop the vehicle", SAFETY, "safety_core.cpp",
     "if (must_stop && ", "if (false && must_stop && "),
    ("latch: drives' faults", SAFETY, "safety_core.cpp",
     "if (phase == DrivePhase::faulted) {", "if (false) {"),
    ("latch: drives that leave operation", SAFETY, "safety_core.cpp",
     "if (!as_wanted) {", "if (false) {"),
    ("latch: missing feedback", SAFETY, "safety_core.cpp",
     "} else if (!drives.feedback_fresh) {", "} else if (false) {"),
    ("latch: wheels that do not follow", SAFETY, "safety_core.cpp",
     "if (!trouble.empty()) latch_fault(trouble);", ""),
    ("latch: wheels that run ahead", SAFETY, "follow_monitor.cpp",
     "std::max(sums.behind_m, sums.ahead_m)", "sums.behind_m"),
    ("latch: bus failures", SAFETY, "safety_core.cpp", "switch (worst) {",
     "switch (worst < CanState::stalled ? worst : CanState::up) {"),
    ("latch: bus failures between cycles", SAFETY, "safety_core.cpp",
     "worst = std::max(worst_bus_, bus);", "worst = bus;"),
    ("latch: reset without restarting a jammed bus", SAFETY, "safety_requests.cpp",
     "} else if (bus_was_jammed_ || restart_unfinished_) {", "} else if (false) {"),
    ("latch: old setpoints stay in a stalled bus", SAFETY, "safety_core.cpp",
     "action_ = Decision::Action::restart_bus;", ""),

    # Stopping
    ("standstill: power off after the ramp while rolling", SAFETY, "safety_core.cpp",
     "if (drives.standstill) {", "if (true) {"),
    ("standstill: power off during a quick stop", SAFETY, "safety_core.cpp",
     "if (drives.standstill && drives.feedback_fresh && ", "if ("),
    ("standstill: rolling on after the ramp goes unnoticed", SAFETY, "safety_core.cpp",
     "} else if (now - *setpoint_zero_since_ >= kStandstillWait) {", "} else if (false) {"),
    ("leaving: at once", SAFETY, "safety_core.cpp",
     "return a_cycle_since && motion_ == Motion::idle && powered_off;", "return true;"),

    # Limits
    ("limits: speed", SAFETY, "twist_limiter.cpp",
     "scale_to(max_v, std::abs(target.v_mps))", "1.0"),
    ("limits: yaw rate", SAFETY, "twist_limiter.cpp",
     "scale_to(limits_.max_yaw_rate_radps, std::abs(target.omega_radps))", "1.0"),
    ("limits: wheel speed of the target", SAFETY, "twist_limiter.cpp",
     "scale_to(limits_.max_wheel_speed_mps, fastest)", "1.0"),
    ("limits: wheel speed on the way", SAFETY, "twist_limiter.cpp",
     "std::clamp(target.v_mps, -v_room, v_room)", "target.v_mps"),
    ("limits: the curve is not kept", SAFETY, "twist_limiter.cpp",
     "return {target.v_mps * scale, target.omega_radps * scale};",
     "return {target.v_mps * scale, target.omega_radps};"),
    ("limits: acceleration", SAFETY, "axis_ramp.cpp",
     "return {limits_.acceleration, step};", "return {1e3, step};"),
    ("limits: deceleration", SAFETY, "axis_ramp.cpp",
     "return {limits_.deceleration, step};", "return {1e3, step};"),
    ("limits: acceleration beyond zero", SAFETY, "axis_ramp.cpp",
     "std::min(limits_.deceleration, crossing)", "limits_.deceleration"),
    ("limits: jerk", SAFETY, "axis_ramp.cpp",
     "step_(limits.jerk * cycle_s),", "step_(10.0 * limits.jerk * cycle_s),"),
    ("limits: jerk delays a stop", SAFETY, "twist_limiter.cpp",
     "std::max(jerk, punctual)", "jerk"),

    # What may leave
    ("output: setpoints while not moving", SAFETY, "safety_core.cpp",
     "decision.may_move = motion_ == Motion::following", "decision.may_move = true"),
    ("whitelist: lets setpoints pass", SAFETY, "transmit_whitelist.cpp",
     "if (may_move) return true;", "return true;"),
    ("whitelist: setpoints by SDO", SAFETY, "transmit_whitelist.cpp",
     "if (writes_setpoint_by_sdo(frame)) {", "if (false) {"),
    ("whitelist: extended and remote frames", SAFETY, "transmit_whitelist.cpp",
     " || frame.extended || frame.remote", ""),
    ("whitelist: is not asked", NODE, "can_bridge_node.cpp",
     "} else if (whitelist_.pass(frame, decision.may_move)) {", "} else {"),
    ("node: sends what is left of a suspended cycle", NODE, "can_bridge_node.cpp",
     "if (loop_.now() - now >= cycle_) {", "if (false) {"),
    ("node: makes up for missed cycles", NODE, "can_bridge_node.cpp",
     "if (now - scheduled >= cycle_) {", "if (false) {"),
    ("node: beats on after the end", NODE, "can_bridge_node.cpp", "if (left_) return;", ""),
    ("node: bus events are lost", NODE, "can_bridge_node.cpp",
     "safety_.on_bus_state(state);", "(void)state;"),
]
