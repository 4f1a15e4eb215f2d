#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <string>

namespace tether {

/// Cache of file contents, valid while the file is unchanged: the
/// runs of a sweep, and a relay whose loop must not wait for a file. Keeps the latest few. Any
/// thread may ask.
template <class Content>
class FileStore {
 public:
  using Load = std::function<Content(const std::string& file)>;
  static constexpr std::size_t kKept = 4;

  explicit FileStore(Load load) : load_(std::move(load)) {}

  /// Throws what loading throws, and then keeps nothing.
  std::shared_ptr<const Content> get(const std::string& file) {
    const State state = state_of(file);
    const bool settled = std::filesystem::file_time_type::clock::now() - state.changed > kTick;
    {
      const std::lock_guard lock(mutex_);
      for (const Entry& entry : entries_) {
        if (entry.file == file && entry.state == state) return entry.content;
      }
    }
    auto content = std::make_shared<const Content>(load_(file));
    const std::lock_guard lock(mutex_);
    std::erase_if(entries_, [&](const Entry& entry) { return entry.file == file; });
    if (settled) entries_.push_back({file, state, content});
    if (entries_.size() > kKept) entries_.pop_front();
    return content;
  }

 private:
  // A file may change twice within a tick of the clock that stamps it, and keep its size.
  static constexpr std::chrono::milliseconds kTick{50};

  /// By which one sees that a file is another, as far as the file system tells.
  struct State {
    std::filesystem::path place;
    std::filesystem::file_time_type changed;
    std::uintmax_t size = 0;
    bool operator==(const State&) const = default;
  };
  struct Entry {
    std::string file;
    State state;
    std::shared_ptr<const Content> content;
  };

  static State state_of(const std::string& file) {
    std::error_code none;  // a missing file has no time, and loading it reports that
    return {std::filesystem::weakly_canonical(file, none),
            std::filesystem::last_write_time(file, none), std::filesystem::file_size(file, none)};
  }

  Load load_;
  std::mutex mutex_;
  std::list<Entry> entries_;  // the oldest first
};

}  // namespace tether
