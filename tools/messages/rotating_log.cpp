#include "tools/messages/rotating_log.hpp"

#include <fmt/format.h>
#include <sys/statvfs.h>

#include <array>
#include <map>
#include <system_error>
#include <utility>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"
#include "tools/messages/event_log.hpp"

namespace tether {

namespace fs = std::filesystem;

namespace {

constexpr std::string_view kEnding = ".lcmlog";

/// Files of this name in the folder, by their numbers.
std::map<std::uint64_t, fs::path> logs_in(const fs::path& folder, const std::string& name) {
  std::map<std::uint64_t, fs::path> found;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    const std::string file = entry.path().filename();
    if (!file.starts_with(name + "-") || !file.ends_with(kEnding)) continue;
    const std::string digits =
        file.substr(name.size() + 1, file.size() - name.size() - 1 - kEnding.size());
    const auto number = to_number<std::int64_t>(digits);
    if (number && *number > 0) found[static_cast<std::uint64_t>(*number)] = entry.path();
  }
  return found;
}

void put_number(std::uint8_t*& to, std::uint64_t value, int bytes) {
  while (bytes-- > 0) *to++ = static_cast<std::uint8_t>(value >> (8 * bytes));
}

}  // namespace

std::uint64_t RotatingLog::free_bytes_of(const fs::path& folder) {
  struct statvfs system {};
  if (statvfs(folder.c_str(), &system) != 0) return 0;
  return std::uint64_t{system.f_bavail} * system.f_frsize;
}

RotatingLog::RotatingLog(Settings settings) : settings_(std::move(settings)) {
  if (!fs::is_directory(settings_.folder)) {
    throw UsageError(fmt::format("no such folder: \"{}\"", settings_.folder.string()));
  }
  const auto logs = logs_in(settings_.folder, settings_.name);
  if (!logs.empty()) number_ = logs.rbegin()->first;
  if (make_room()) open_next();
}

void RotatingLog::open_next() {
  file_ = settings_.folder / fmt::format("{}-{:08}{}", settings_.name, number_ + 1, kEnding);
  out_.reset(std::fopen(file_.c_str(), "wxe"));
  if (!out_) {
    throw UsageError(fmt::format("cannot write \"{}\": {}", file_.string(),
                                 std::generic_category().message(errno)));
  }
  ++number_;
  bytes_ = 0;
}

bool RotatingLog::write(std::string_view channel, std::span<const std::uint8_t> bytes,
                        std::int64_t utime) {
  if (!out_) {
    ++lost_;
    return false;
  }
  std::array<std::uint8_t, EventLogReader::kHeaderBytes> header{};
  std::uint8_t* to = header.data();
  put_number(to, EventLogReader::kMagic, 4);
  put_number(to, static_cast<std::uint64_t>(written_), 8);
  put_number(to, static_cast<std::uint64_t>(utime), 8);
  put_number(to, channel.size(), 4);
  put_number(to, bytes.size(), 4);
  put(header.data(), header.size());
  put(channel.data(), channel.size());
  put(bytes.data(), bytes.size());
  ++written_;
  if (bytes_ >= settings_.file_bytes) end_file();
  return true;
}

void RotatingLog::put(const void* bytes, std::size_t size) {
  if (std::fwrite(bytes, 1, size, out_.get()) != size) fail();
  bytes_ += size;
}

void RotatingLog::fail() const {
  throw std::system_error(errno, std::generic_category(),
                          fmt::format("cannot write \"{}\"", file_.string()));
}

void RotatingLog::end_file() {
  if (std::fclose(out_.release()) != 0) fail();
  if (make_room()) open_next();
}

void RotatingLog::flush() {
  if (out_ && std::fflush(out_.get()) != 0) fail();
  const bool room = make_room();
  if (out_ && !room) end_file();
  if (!out_ && room) open_next();
}

/// Deletes old files until there are few enough and enough space is free; false if there is not,
/// with the newest file alone.
bool RotatingLog::make_room() {
  const auto is_short = [this] {
    return settings_.free_bytes(settings_.folder) < settings_.keep_free_bytes;
  };
  auto logs = logs_in(settings_.folder, settings_.name);
  const std::uint64_t most = out_ ? settings_.files : settings_.files - 1;  // the next is another
  while (logs.size() > most || (logs.size() > 1 && is_short())) {
    std::error_code error;
    fs::remove(logs.begin()->second, error);
    logs.erase(logs.begin());
  }
  return !is_short();
}

}  // namespace tether
