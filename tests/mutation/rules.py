"""Rules that keep a vehicle safe. Each names the mutants that break it: all those of this operator
whose function and text (syntax.py) these regular expressions find. There must be one, and none may
live."""


def _obstacle(name, condition, operator="false"):
    """Arming goes on in spite of `condition`."""
    return (f"arming: {name}", "obstacle_to_arming", operator, f"^{condition}$")


# What no operator makes: (rule, function, what is replaced, by what).
SPECIAL = [
    ("freshness: rejected commands refresh", "CommandWatch::offer", r"^\+\+non_finite_$",
     "++non_finite_, as_of_ = now"),
    ("freshness: a plan that is over stays fresh", "CommandWatch::age", r"^std::max\(\*plan_age, overdue\(now\)\)$", "Duration{0}"),
    ("requests: stamps of the future", "RequestGuard::accept", r"guard\.accept\(now, stamp",
     "guard.accept(stamp > now ? stamp : now, stamp"),
    ("arming: drives restart meanwhile", "watch_drives", r"power_on \|\| phase == DrivePhase::standby",
     "power_on || phase == DrivePhase::standby || phase == DrivePhase::starting"),
    ("arming: without any command", "obstacle_to_arming", r"^commands_\.age\(now\)$",
     "std::optional<Duration>(commands_.age(now).value_or(Duration{0}))"),
    ("arming: tiny is large", "CommandWatch::is_zero", "kTiny_mps", "1.0"),
    ("latch: releasing the e-stop unlatches", "SafetyCore::handle", "^estop_pressed_ = false$",
     "estop_pressed_ = estop_latched_ = false"),
    ("latch: reset arms", "finish_reset", "^estop_latched_ = false$",
     "estop_latched_ = false, motion_ = Motion::enabling"),
    ("latch: slow wheels", "FollowMonitor::update", r"k < kTests\.size\(\)", "k < 1"),
    ("limits: acceleration", "AxisRamp::limits_towards", r"^\{limits_\.acceleration,", "{1e3,"),
    ("limits: deceleration", "AxisRamp::limits_towards", r"^\{limits_\.deceleration,", "{1e3,"),
    ("node: the profile keeps the old speed", "CanBridgeNode", r"^profile_->set_command\(decision\.twist\)$",
     "decision.may_move ? profile_->set_command(decision.twist) : (void)0"),
]

RULES = [
    *((name, function, "special", f"^{name}: ") for name, function, _, _ in SPECIAL),

    # Freshness of commands
    ("freshness: stale commands are followed", "SafetyCore::watch_age", "false", r"age >= .*stale"),
    ("freshness: never disarms", "SafetyCore::follow", "true", r"age < .*disarm"),
    ("freshness: the network's delay does not count", "CommandWatch::offer", "choice", "stamp.* to now$"),
    ("freshness: a stamp ahead stays fresh longer", "CommandWatch::offer", "choice", "stamp.* to stamp$"),
    ("freshness: a plan counts from the last twist", "CommandWatch::age$", "false", "plan_age"),
    ("input: duplicated, late and future commands", "CommandWatch::offer", "false", "guard_"),
    ("input: stamps far ahead", "SafetyCore::SafetyCore", "choice", "kMaxAhead.*to config.stale / 2$"),
    ("input: stamps ahead by more than half the stale time", "SafetyCore::SafetyCore", "choice",
     "to kMaxAhead$"),
    ("input: numbers that are not finite", "CommandWatch::offer", "false", "is_usable"),
    ("own loop: a gap goes unnoticed", "SafetyCore::watch_own_loop", "false", "disarm"),

    # Requests
    ("requests: old ones act", "RequestGuard::accept", "true", "kFresh"),
    ("requests: each acts more than once", "RequestGuard::accept", "operand", r"guard\."),
    ("requests: stay pending", "SafetyCore::cycle", "drop", r"requests_\.clear"),
    ("requests: a late e-stop is ignored", "RequestGuard::accept", "operand", "estop"),
    ("requests: a late disarm is ignored", "RequestGuard::accept", "operand", "disarm"),

    # Arming
    _obstacle("e-stop latched", "estop_latched_"),
    _obstacle("fault latched", "fault_latched_"),
    _obstacle("leaving", "leaving_since_"),
    _obstacle("a safety input demands a stop", r"!demands_\.stop\.empty\(\)"),
    _obstacle("together with a reset", "action_ != Decision::Action::none"),
    _obstacle("bus not up", "bus != CanState::up"),
    _obstacle("drives not in standby", r"drives\.phase != DrivePhase::standby"),
    _obstacle("no feedback", r"!drives\.feedback_fresh"),
    _obstacle("wheels turning", r"!drives\.standstill"),
    _obstacle("still stopping", "motion_ != Motion::idle"),
    _obstacle("stale command", r"\*age >= .*stale"),
    _obstacle("command not zero", r"!commands_\.is_zero.*"),
    ("arming: the command is not zero at its end", "begin_following", "false", "is_zero"),
    ("arming: the command is stale at its end", "begin_following", "false", "stale"),

    # Plans
    ("plans: survive a quick stop", "begin_quick_stop", "drop", r"commands_\.end_plans"),
    ("plans: survive a disarm", "begin_ramp_down", "drop", r"commands_\.end_plans"),
    ("plans: survive a reset", "finish_reset", "drop", r"commands_\.end_plans"),
    ("plans: come late", "PlanBuffer::judge", "false", r"plan\.stamp < stopped_"),
    ("plans: of the dead arm", "obstacle_to_arming", "false", r"why\.empty"),
    ("plans: of the dead arm at its end", "begin_following", "false", r"why\.empty"),
    ("plans: made from no pose", "PlanBuffer::judge_pose", "false", r"!plan\.pose"),
    ("plans: made from an older pose", "PlanBuffer::judge_pose", "false", "newest_pose_"),
    ("plans: of another session while armed", "PlanBuffer::may_take_over", "false", "session_held_"),
    ("plans: last however long nobody sees the vehicle", "CommandWatch::age", "choice", "to \\*plan_age$"),
    ("plans: drive as fast as they like unseen", "follow_within_budget", "false", "planned"),
    ("plans: a stop of another session", "SafetyCore::on_plan", "false", "is_stop"),
    ("commands: made from an old pose", "CommandWatch::offer", "false", "max_blind_"),
    ("commands: of two programs", "watch_senders", "false", "several_senders_"),
    ("commands: of two senders", "watch_senders", "false", "two_senders"),
    ("commands: drive far on a stale one", "SafetyCore::watch_age", "operand", "too_far"),
    ("operator: lets go", "watch_senders", "false", "is_held"),
    ("plans: preloads while armed", "SafetyCore::on_plan", "false", "preload"),

    # Latches
    ("latch: faults do not", "latch_fault", "negate", "fault_latched_ = true"),
    ("latch: the e-stop does not", "SafetyCore::handle", "drop", "estop_latched_ = true"),
    ("latch: reset while the e-stop is pressed", "SafetyCore::reset", "operand", "^estop_pressed_$"),
    ("latch: reset while the wheels turn", "SafetyCore::reset", "false", "feedback_fresh && !.*standstill"),
    ("latch: a queue that was not emptied is forgotten", "on_bus_restarted", "drop", "purge_failure_"),
    ("latch: reset believes a wrong encoder", "SafetyCore::reset", "false",
     "did_not_follow_ && distrust_until_"),
    ("latch: reset with a wrong encoder and power on", "SafetyCore::reset", "false",
     "did_not_follow_ && drives"),
    ("latch: reset while still stopping", "SafetyCore::reset", "false", "motion_ != Motion::idle"),
    ("latch: does not stop the vehicle", "SafetyCore::cycle", "false", "must_stop && "),
    ("latch: drives' faults", "watch_drives", "false", "phase == DrivePhase::faulted"),
    ("latch: drives that leave operation", "watch_drives", "false", "!as_wanted"),
    ("latch: missing feedback", "watch_drives", "false", r"!drives\.feedback_fresh"),
    ("latch: wheels that do not follow", "watch_drives", "drop", r"latch_fault\(trouble"),
    ("latch: wheels that run ahead", "FollowMonitor::exceeds", "choice", r"ahead_m\) to sums\.behind_m$"),
    ("latch: bus failures", "watch_bus", "drop", "latch_fault"),
    ("latch: bus failures between cycles", "watch_bus", "choice", "to bus$"),
    ("latch: reset without restarting a jammed bus", "SafetyCore::reset", "false", "bus_was_jammed_"),
    ("latch: old setpoints stay in a stalled bus", "purge_bus", "drop", "restart_bus"),

    # Safety inputs
    ("inputs: a stop is not obeyed", "obey_inputs", "drop", "begin_quick_stop"),
    ("inputs: a ramp is not obeyed", "obey_inputs", "drop", r"handle\(DriveRequest::disarm"),
    ("inputs: one that may restart does not stop", "SafetyCore::follow", "operand", r"^demands_\.stop"),
    ("inputs: the e-stop contact does not latch", "obey_inputs", "drop", "estop_latched_ = true"),
    ("inputs: reset while the contact is open", "SafetyCore::reset", "operand", r"^!demands_\.estop"),
    ("inputs: no speed limit", "SafetyCore::permitted", "true", "speed_limit_mps"),
    ("inputs: silence", "SafetyInputs::condition", "false", "!heard"),
    ("inputs: demands between two cycles", "SafetyInputs::condition", "choice", r"to input\.level$"),
    ("inputs: wrong lengths", "SafetyInputs::judge", "false", "frame.size"),
    ("inputs: contradictions", "SafetyInputs::judge", "true", r"!can\.stop \|\|"),
    ("inputs: goes on after silence", "SafetyInputs::demand", "drop", "may_resume = false"),
    ("inputs: goes on at once", "SafetyInputs::demand", "false", r"^config\.restart_after_s &&"),
    ("inputs: are not asked", "CanBridgeNode", "drop", "on_safety_inputs"),

    # Stopping
    ("standstill: power off after the ramp while rolling", "ramp_down", "true", r"^drives\.standstill$"),
    ("standstill: power off during a quick stop", "finish_stop", "operand", r"^drives\.standstill$"),
    ("standstill: rolling on after the ramp goes unnoticed", "ramp_down", "false", "kStandstillWait"),
    ("leaving: at once", "has_left", "true", "a_cycle_since &&"),
    ("leaving: wheels that turn", "has_left", "operand", "!turning_"),
    ("leaving: drives of which nothing is known", "has_left", "operand", "!in_doubt_"),
    ("leaving: not told", "SafetyCore::.*", "true", r"!leaving_since_ \|\|"),
    ("standstill: believed of lying encoders", "finish_stop", "true", "distrust_until_"),
    ("standstill: lying encoders, missing feedback", "watch_drives", "drop", "feedback_lies_ = true"),
    ("standstill: distrusted for ever", "SafetyCore::arm", "drop", "feedback_lies_ = false"),
    ("standstill: one of before a drive's quick stop", "Axes::stop_controlword", "operand",
     r"^axis\.confirmed_standing\(now\)$"),
    ("standstill: a distrusted one of a drive", "Axes::stop_controlword", "operand", "^believes_standstill"),
    ("standstill: one of before the stop ends the braking", "Stopping::brake", "true", "^at_once$"),
    ("standstill: a distrusted one ends the braking", "Stopping::brake", "operand",
     r"^d_\.axes\.believes_standstill"),
    ("standstill: turns count not", "braking_time", "choice", "to std::abs.from.v_mps"),

    # The second time round
    ("again: starts with the old speed", "begin_following", "drop", r"limiter_\.reset"),
    ("again: old quarrels with the wheels", "begin_following", "drop", r"monitor_\.reset"),
    ("again: no quick stop after a disarm", "begin_quick_stop", "drop", "disable_sent_ = false"),
    ("again: the old time to stand still", "begin_ramp_down", "drop", r"setpoint_zero_since_\.reset"),
    ("again: an old queue counts", "finish_reset", "drop", r"purge_failure_\.clear"),

    # Limits
    ("limits: speed, yaw rate, wheel speed", "within_speed_limits", "choice", "scale_to.* to std::min"),
    ("limits: wheel speed on the way", "TwistLimiter::advance", "choice", "v_room.* to target.v_mps$"),
    ("limits: the curve is not kept", "within_speed_limits", "arithmetic", r"omega_radps \* scale to target"),
    ("limits: acceleration beyond zero", "limits_towards", "choice", "crossing.* to limits_.deceleration"),
    ("limits: jerk", "AxisRamp::AxisRamp", "arithmetic", r"^limits\.jerk \* cycle_s to /"),
    ("limits: jerk delays a stop", "axis_limits", "choice", "to jerk$"),

    # What may leave
    ("output: setpoints while not moving", "SafetyCore::cycle", "true", "motion_ == Motion::following"),
    ("whitelist: lets setpoints pass", "TransmitWhitelist::pass", "true", "^may_move$"),
    ("whitelist: setpoints by SDO", "TransmitWhitelist::pass", "false", "writes_setpoint_by_sdo"),
    ("whitelist: switching on by SDO", "TransmitWhitelist::pass", "operand", "switches_on_by_sdo"),
    ("whitelist: extended and remote frames", "TransmitWhitelist::pass", "operand",
     r"^frame\.(extended|remote)$"),
    ("whitelist: is not asked", "CanBridgeNode", "true", r"whitelist_\.pass"),
    ("node: does not switch the drives off", "CanBridgeNode", "drop", r"StopKind::disable"),
    ("node: does not quick stop", "CanBridgeNode", "drop", r"StopKind::quick"),
    ("node: does not reset the drives", "CanBridgeNode", "drop", "reset_fault"),
    ("node: the profile believes lying encoders", "CanBridgeNode", "false", "^decision.distrust_until$"),
    ("node: sends what is left of a suspended cycle", "CanBridgeNode", "false", r"loop_\.now\(\) - now"),
    ("node: makes up for missed cycles", "CanBridgeNode", "false", "now - scheduled"),
    ("node: beats on after the end", "CanBridgeNode::on_cycle", "false", "^left_$"),
    ("node: bus events are lost", "CanBridgeNode", "drop", r"^safety_\.on_bus_state"),
    ("node: ends as if all were well", "CanBridgeNode::finish", "false", "left"),
]

# Of sources that need a kernel with CAN. Each takes some seconds there.
CAN_RULES = [
    ("socket: sends at bus-off", "SocketCanPort::send", "operand", "^state_ != CanState::bus_off$"),
    ("socket: sends into a stall", "SocketCanPort::send", "operand", "^writable"),
    ("socket: a stall goes unnoticed", "on_failed_send", "true", "kStallTime"),
    ("socket: one frame too many is a stall", "on_failed_send", "operand", "kStallTime$"),
    ("socket: an adapter that went goes unnoticed", "on_failed_send", "false", "ENETDOWN"),
    ("socket: keeps the socket of an interface that is gone", "follow_link", "false", r"deleted \|\|"),
    ("socket: forged error frames are believed", "on_error_frame", "false", "Controller::none"),
    ("socket: lost frames go uncounted", "set_options", "drop", "SO_RXQ_OVFL"),
    ("socket: bus-off is not a state", "set_state", "false", "Controller::bus_off"),
    ("socket: down is not a state", "set_state", "false", "^!link_.up"),
    ("socket: nobody learns why a restart failed", "restart", "drop", "restarting"),
]
