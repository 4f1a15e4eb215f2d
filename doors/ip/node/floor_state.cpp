#include "doors/ip/node/floor_state.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <sstream>
#include <utility>

namespace tether::ip {
namespace {

constexpr const char* kFiles[] = {"state", "state.part", "hosts", "lock"};

}  // namespace

std::filesystem::path default_floor_folder() {
  const char* const runtime = std::getenv("XDG_RUNTIME_DIR");
  if (runtime != nullptr && *runtime != '\0')
    return std::filesystem::path(runtime) / "tether-floor";
  return fmt::format("/tmp/tether-floor-{}", geteuid());
}

FloorState::FloorState(std::filesystem::path folder) : folder_(std::move(folder)) {
  mkdir(folder_.c_str(), 0700);
  struct stat found {};
  const bool ours =
      lstat(folder_.c_str(), &found) == 0 && S_ISDIR(found.st_mode) && found.st_uid == geteuid();
  if (!ours) {
    throw UsageError(
        fmt::format("--floor {} is not a folder of this user: name another one", folder_.string()));
  }
  lock_ = check_system_call("opening " + (folder_ / "lock").string(),
                            open((folder_ / "lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600));
  if (flock(lock_, LOCK_EX | LOCK_NB) != 0) {
    close(lock_);
    throw already_up(folder_);
  }
  std::filesystem::remove(folder_ / "state");
  const std::string pid = fmt::format("{}\n", getpid());
  if (ftruncate(lock_, 0) != 0 || ::write(lock_, pid.data(), pid.size()) < 0) {
    throw std::system_error(errno, std::generic_category(), "writing the floor's lock");
  }
}

FloorState::~FloorState() {
  remove_floor_folder(folder_);
  close(lock_);
}

void FloorState::write(const std::vector<HostEntry>& hosts) const {
  const auto part = folder_ / "state.part";
  std::ofstream out(part);
  for (const HostEntry& host : hosts) {
    out << host.name << ' ' << host.address << ' ' << host.process << '\n';
  }
  out.close();
  if (!out) throw std::runtime_error("cannot write " + part.string());
  std::filesystem::rename(part, folder_ / "state");
}

UsageError already_up(const std::filesystem::path& folder) {
  return UsageError(
      fmt::format("a floor is up already in {}: run `tether floor down` first", folder.string()));
}

std::optional<pid_t> floor_process(const std::filesystem::path& folder) {
  const int lock = open((folder / "lock").c_str(), O_RDONLY | O_CLOEXEC);
  if (lock < 0) return std::nullopt;
  const bool is_free = flock(lock, LOCK_SH | LOCK_NB) == 0;
  close(lock);
  std::ifstream in(folder / "lock");
  pid_t process = 0;
  if (is_free || !(in >> process) || process <= 0) return std::nullopt;
  return process;
}

std::vector<HostEntry> read_hosts(const std::filesystem::path& folder) {
  std::vector<HostEntry> hosts;
  if (!floor_process(folder)) return hosts;
  std::ifstream in(folder / "state");
  HostEntry host;
  while (in >> host.name >> host.address >> host.process) hosts.push_back(host);
  return hosts;
}

void remove_floor_folder(const std::filesystem::path& folder) {
  std::error_code ignored;
  for (const char* const file : kFiles) std::filesystem::remove(folder / file, ignored);
  std::filesystem::remove(folder, ignored);
}

}  // namespace tether::ip
