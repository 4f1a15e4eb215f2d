#pragma once

namespace tether {

/// All control laws, once: each has its value of controller.law, is made by the function
/// `make_<name>_law` of controller/laws/law.hpp, and sends twists or plans. A new law is a file
/// controller/<...>_law.cpp and a line here.
#define TETHER_CONTROL_LAWS(LAW)    \
  LAW(pid, twists)                  \
  LAW(pid_adaptive, twists)         \
  LAW(tracking, twists)             \
  LAW(tracking_compensated, twists) \
  LAW(predictive, plans)            \
  LAW(predictive_consistent, plans)

#define TETHER_LAW_NAME(name, sends) name,
enum class ControlLaw { TETHER_CONTROL_LAWS(TETHER_LAW_NAME) };
#undef TETHER_LAW_NAME

constexpr bool sends_plans(ControlLaw law) {
  enum class Sends { twists, plans };
#define TETHER_LAW_SENDS(name, sends) Sends::sends,
  constexpr Sends kSends[] = {TETHER_CONTROL_LAWS(TETHER_LAW_SENDS)};
#undef TETHER_LAW_SENDS
  return kSends[static_cast<int>(law)] == Sends::plans;
}

}  // namespace tether
