#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "common/base/time.hpp"

namespace tether {

/// Remembers on disk that the e-stop is latched, so that the latch outlives a crash of the bridge,
/// a restart, a power failure and a full disk.
///
/// The file has a fixed size and one of three records: "in use", "latched", "ended". It is created,
/// filled and synced before the bridge runs, and only overwritten in place from then on, which
/// needs no space. Only "ended" proves a clean end without a latched e-stop: a bridge that finds
/// anything else, or no file, starts with the e-stop pressed. Therefore a bridge that is killed
/// while its record cannot be written is latched at its next start, too.
class EstopFile {
 public:
  /// A write that failed is repeated at most this often.
  static constexpr Duration kRetry = std::chrono::seconds{1};

  /// Creates the folder and the file. Throws UsageError if it cannot be written, or if `path` is
  /// not a regular file: a FIFO, a device or a symbolic link is refused, not opened.
  explicit EstopFile(std::filesystem::path path);
  ~EstopFile();
  EstopFile(EstopFile&& other) noexcept;
  EstopFile& operator=(EstopFile&& other) noexcept;

  /// Whether the bridge has to start with the e-stop pressed, and why.
  bool latched() const { return !why_.empty(); }
  const std::string& why() const { return why_; }

  /// Each cycle: writes the record if it changes (and waits for the disk: a stop has been sent
  /// before), then verifies that the path still names this file and that the file has the record.
  void remember(bool latched, Instant now);

  /// Why the e-stop would not be remembered; "" if it would. A file that was deleted, replaced or
  /// changed is never trusted again, and gets the record "latched", once a second if need be: what
  /// another program wrote there proves no clean end of this bridge. A failed write is repeated.
  /// Each new reason is also said on stderr.
  const std::string& trouble() const { return trouble_; }

  /// The bridge ends in good order: power off, wheels at standstill. Writes "ended", unless the
  /// e-stop is latched or the file is not trusted.
  void end();

 private:
  class Descriptor;

  std::string write(const std::string& record);
  std::string verify() const;
  /// Leaves "latched" in the file that the path names now, if there is one.
  void revoke() const;
  void tell(std::string trouble);

  std::filesystem::path path_;
  std::unique_ptr<Descriptor> file_;
  std::string record_;  ///< the newest one that is on disk
  std::string why_;
  std::string trouble_;
  bool lost_ = false;  ///< not trusted again
  Instant retry_at_ = Instant::min();
};

/// Where bridges with real drives keep it: estop.VEHICLE.INTERFACE in state_folder().
std::filesystem::path default_estop_file(const std::string& vehicle, const std::string& interface);

}  // namespace tether
