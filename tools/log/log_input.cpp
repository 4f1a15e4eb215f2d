#include "tools/log/log_input.hpp"

#include <fmt/format.h>

#include "common/base/errors.hpp"
#include "common/base/input_file.hpp"

namespace tether {

LogInput::LogInput(const std::string& path)
    : stream_(open_input(path, "the log", kMostRecordingBytes)), reader(stream_) {
  if (!reader.looks_like_log()) {
    throw UsageError(fmt::format(
        "{} is not an LCM event log: it does not begin with the bytes ed a1 da 01", path));
  }
}

std::string describe(const LogDamage& damage) {
  if (damage.truncated_tail) {
    return fmt::format("TRUNCATED: ends in the middle of the record at byte {}; {} bytes lost",
                       damage.offset_bytes, damage.size_bytes);
  }
  return fmt::format("DAMAGED: no usable record from byte {} on; {} bytes skipped",
                     damage.offset_bytes, damage.size_bytes);
}

}  // namespace tether
