#pragma once

#include <string_view>

namespace tether {

/// How much a line matters; numbers as syslog(3) has them.
enum class Severity { error = 3, warning = 4, info = 6 };

/// Prints a line for the operator on stderr. If stderr is systemd's journal, the line carries the
/// severity (sd-daemon(3)): `journalctl -p warning`. A line that cannot be written, as to a full
/// disk, is lost; nothing is thrown.
void say(Severity severity, std::string_view line);

}  // namespace tether
