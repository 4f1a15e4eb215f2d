#pragma once

namespace tether {

/// All control laws, once: each has its value of controller.law and is made by the function
/// `make_<name>_law` of controller/law.hpp. A new law is a file in controller/ and a line here.
#define TETHER_CONTROL_LAWS(LAW) \
  LAW(pid)                       \
  LAW(pid_adaptive)              \
  LAW(tracking)                  \
  LAW(tracking_compensated)      \
  LAW(predictive)                \
  LAW(predictive_consistent)

#define TETHER_LAW_NAME(name) name,
enum class ControlLaw { TETHER_CONTROL_LAWS(TETHER_LAW_NAME) };
#undef TETHER_LAW_NAME

}  // namespace tether
