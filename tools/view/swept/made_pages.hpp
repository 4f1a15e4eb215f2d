#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>

namespace tether {

/// State of a page that takes long to make.
struct MadePage {
  enum class State : std::uint8_t { waiting, in_work, ready, failed };
  State state = State::waiting;
  double share = 0.0;                            ///< completed share of the work
  std::shared_ptr<const std::string> page = {};  ///< when it is ready
  std::string error = {};                        ///< when it has failed
};

/// Pages that are made on request: one after the other, in a thread of its own, in
/// the order in which they were asked for. The newest are kept. All functions may be called from
/// any thread, and none waits for the work.
class MadePages {
 public:
  /// Tells how much is done, 0 to 1. Throws, through all of the work, when that is not wanted any
  /// more.
  using Progress = std::function<void(double share)>;
  /// Makes the page of a name. What it throws is the reader's answer.
  using Make = std::function<std::string(const std::string& name, const Progress& progress)>;

  static constexpr std::size_t kMostWaiting = 8;
  static constexpr std::size_t kMostKept = 8;

  explicit MadePages(Make make);
  /// Gives up what is in work.
  ~MadePages() = default;
  MadePages(const MadePages&) = delete;
  MadePages& operator=(const MadePages&) = delete;

  /// How it stands; begins with it if that has not been done. Fails where too many wait.
  MadePage ask(const std::string& name);
  /// The page if it is ready, else null.
  std::shared_ptr<const std::string> find(const std::string& name) const;

 private:
  void work(const std::stop_token& stop);
  MadePage made(const std::string& name, const std::stop_token& stop);
  void finish(const std::string& name, MadePage page);

  Make make_;
  mutable std::mutex mutex_;
  std::condition_variable_any asked_;
  std::map<std::string, MadePage> pages_;
  std::deque<std::string> waiting_;
  std::deque<std::string> kept_;  ///< ready or failed, oldest first
  std::jthread worker_;           ///< ends before what it uses
};

}  // namespace tether
