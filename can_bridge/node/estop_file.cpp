#include "can_bridge/node/estop_file.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <system_error>
#include <utility>

#include "can_bridge/drivetrain/state_folder.hpp"
#include "common/base/errors.hpp"
#include "common/base/say.hpp"

namespace tether {

namespace fs = std::filesystem;

class EstopFile::Descriptor {
 public:
  explicit Descriptor(int fd) : fd(fd) {}
  ~Descriptor() { ::close(fd); }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;

  const int fd;
};

namespace {

// One sector, so that a record is written whole or not at all.
constexpr std::size_t kRecordBytes = 512;

std::string record(const char* state) {
  std::string text = fmt::format("tether e-stop record: {}", state);
  text.resize(kRecordBytes - 1, ' ');
  return text + '\n';
}
const std::string kInUse = record("in use");
const std::string kLatched = record("latched");
const std::string kEnded = record("ended");

std::string error_text() { return std::strerror(errno); }

const char* kind_of(mode_t mode) {
  if (S_ISFIFO(mode)) return "a FIFO";
  if (S_ISDIR(mode)) return "a directory";
  if (S_ISLNK(mode)) return "a symbolic link";
  if (S_ISSOCK(mode)) return "a socket";
  return "a device";
}

[[noreturn]] void refuse(const fs::path& path, const std::string& why) {
  throw UsageError(fmt::format(
      "cannot keep the e-stop in \"{}\": {}. Name a writable regular file by can.estop_file",
      path.string(), why));
}

/// Content of the file; "" if the file cannot be read or is longer than a record.
std::string read_record(int fd) {
  std::array<char, kRecordBytes + 1> bytes{};
  const ssize_t size = ::pread(fd, bytes.data(), bytes.size(), 0);
  return size < 0 ? "" : std::string(bytes.data(), static_cast<std::size_t>(size));
}

bool sync_folder_of(const fs::path& path) {
  const fs::path folder = path.has_parent_path() ? path.parent_path() : ".";
  const int fd = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) return false;
  const bool done = ::fsync(fd) == 0;
  return ::close(fd) == 0 && done;
}

/// Never opens what is not a regular file: opening a device may act, opening a FIFO may wait.
int open_regular(const fs::path& path, bool& existed) {
  struct stat status {};
  existed = ::lstat(path.c_str(), &status) == 0;
  if (!existed && errno != ENOENT) refuse(path, error_text());
  if (existed && !S_ISREG(status.st_mode))
    refuse(path, fmt::format("it is {}", kind_of(status.st_mode)));
  const int fd = ::open(path.c_str(), O_RDWR | O_CREAT | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC, 0644);
  if (fd < 0) refuse(path, error_text());
  return fd;
}

}  // namespace

EstopFile::EstopFile(fs::path path) : path_(std::move(path)) {
  std::error_code error;
  if (path_.has_parent_path()) fs::create_directories(path_.parent_path(), error);
  bool existed = false;
  file_ = std::make_unique<Descriptor>(open_regular(path_, existed));
  struct stat status {};
  if (::fstat(file_->fd, &status) != 0) refuse(path_, error_text());
  if (!S_ISREG(status.st_mode)) refuse(path_, fmt::format("it is {}", kind_of(status.st_mode)));

  const std::string found = read_record(file_->fd);
  if (found == kLatched) {
    why_ = "it was latched when the bridge ended";
  } else if (found != kEnded) {
    why_ = fmt::format("\"{}\" {}", path_.string(),
                       !existed          ? "did not exist"
                       : found == kInUse ? "has no proof of a clean end"
                                         : "is no intact record");
  }
  if (::ftruncate(file_->fd, kRecordBytes) != 0) refuse(path_, error_text());
  if (const std::string failure = write(latched() ? kLatched : kInUse); !failure.empty()) {
    refuse(path_, failure);
  }
  if (!sync_folder_of(path_)) refuse(path_, error_text());
}

EstopFile::~EstopFile() = default;
EstopFile::EstopFile(EstopFile&& other) noexcept = default;
EstopFile& EstopFile::operator=(EstopFile&& other) noexcept = default;

std::string EstopFile::write(const std::string& record) {
  const ssize_t size = ::pwrite(file_->fd, record.data(), record.size(), 0);
  if (size < 0 || ::fdatasync(file_->fd) != 0) return error_text();
  if (size != static_cast<ssize_t>(record.size())) return "the disk took only a part of the record";
  record_ = record;
  return "";
}

std::string EstopFile::verify() const {
  struct stat named {};
  struct stat own {};
  if (::lstat(path_.c_str(), &named) != 0) {
    return errno == ENOENT ? "was deleted" : "cannot be verified: " + error_text();
  }
  if (::fstat(file_->fd, &own) != 0) return "cannot be verified: " + error_text();
  if (named.st_dev != own.st_dev || named.st_ino != own.st_ino) return "was replaced";
  if (read_record(file_->fd) != record_) return "was changed by another program";
  return "";
}

void EstopFile::revoke() const {
  struct stat status {};
  if (::lstat(path_.c_str(), &status) != 0 || !S_ISREG(status.st_mode)) return;
  const int fd = ::open(path_.c_str(), O_RDWR | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0) return;
  const Descriptor named(fd);
  if (read_record(fd) == kLatched) return;
  // Trouble is reported already, so that a failure adds nothing.
  if (::pwrite(fd, kLatched.data(), kLatched.size(), 0) > 0) ::fdatasync(fd);
}

void EstopFile::remember(bool latched, Instant now) {
  if (lost_) {
    if (now >= retry_at_) {
      retry_at_ = now + kRetry;
      revoke();
    }
    return;
  }
  const std::string& wanted = latched ? kLatched : kInUse;
  if (wanted != record_) {
    if (now < retry_at_) return;
    if (const std::string failure = write(wanted); !failure.empty()) {
      retry_at_ = now + kRetry;
      return tell("cannot be written: " + failure);
    }
  }
  const std::string trouble = verify();
  lost_ = !trouble.empty();
  if (lost_) {
    retry_at_ = now + kRetry;
    revoke();
  }
  tell(lost_ ? trouble + ": find out why, then restart the bridge" : "");
}

void EstopFile::tell(std::string trouble) {
  if (!trouble.empty()) {
    trouble = fmt::format("the e-stop is not remembered: \"{}\" {}", path_.string(), trouble);
  }
  if (trouble == trouble_) return;
  trouble_ = std::move(trouble);
  if (!trouble_.empty()) say(Severity::error, "tether-can-bridge: " + trouble_);
}

void EstopFile::end() {
  if (lost_) return revoke();
  if (!trouble_.empty() || record_ == kLatched) return;
  if (const std::string failure = write(kEnded); !failure.empty()) {
    tell("cannot be written: " + failure);
  }
}

fs::path default_estop_file(const std::string& vehicle, const std::string& interface) {
  return state_folder() / fmt::format("estop.{}.{}", vehicle, interface);
}

}  // namespace tether
