#include "tests/campaign/rules.hpp"

namespace tether::campaign {

const std::vector<Rule>& rules() {
  static const std::vector<Rule> all{
      {"wheels turn though not armed", wheels_turn_unarmed},
      {"wheels turn on old commands", wheels_turn_on_old_commands},
      {"a wheel turns without setpoints", wheel_turns_without_setpoints},
      {"blind for too long", blind_for_too_long},
      {"blind too far", blind_too_far},
      {"no rest at the end", no_rest_at_the_end},
      {"power cut while turning", power_cut_while_turning},
      {"standstill reported while turning", standstill_reported_while_turning},
      {"armed wheel not as told", armed_wheel_not_as_told},
      {"setpoint forbidden", setpoint_forbidden},
      {"frame forbidden", frame_forbidden},
      {"stop not obeyed", stop_not_obeyed},
      {"armed without a request", armed_without_request},
      {"armed without zero", armed_without_zero},
      {"armed on old commands", armed_on_old_commands},
      {"fault left", fault_left},
      {"e-stop left", estop_left},
      {"fault unnoticed", fault_unnoticed},
      {"frozen encoder unnoticed", frozen_encoder_unnoticed}};
  return all;
}

}  // namespace tether::campaign
