#pragma once

#include <string_view>

namespace tether {

/// The protocol's channels (docs/reference/time.md). No other channel begins with "TIME/".
inline constexpr std::string_view kTimePrefix = "TIME/";
inline constexpr char kTimeJoin[] = "TIME/JOIN";
inline constexpr char kTimeWelcome[] = "TIME/WELCOME";
inline constexpr char kTimeGrant[] = "TIME/GRANT";
inline constexpr char kTimeRequest[] = "TIME/REQUEST";
inline constexpr char kTimeResend[] = "TIME/RESEND";

}  // namespace tether
