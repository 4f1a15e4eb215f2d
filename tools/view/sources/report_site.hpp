#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "tools/experiment/sweep/run_store.hpp"
#include "tools/view/server/page_folder.hpp"
#include "tools/view/server/web_site.hpp"

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

/// The runs of the sweeps of a folder, and how to make one of them again.
class SweepRuns {
 public:
  /// Reads which runs there are: those of the folder's databases (databases_below()), now. Throws
  /// UsageError if there is none.
  explicit SweepRuns(const std::filesystem::path& folder);

  /// Whether that is the address of a run, such as "/runs/4/17" or "/runs/f2_prr/4/17"
  /// (address_of_runs()): of combination 4, with seed 17.
  bool has(std::string_view path) const { return find(path).has_value(); }

  /// Computes the run, which is there, again, and writes its log and its scenario.toml into a
  /// folder; returns the log. `progress` receives the completed share, 0 to 1, at each second of
  /// the run; what it throws ends the run. Throws std::runtime_error, with both versions of Tether,
  /// if it cannot be made or its ε is not that of the sweep. Const, and so for any thread.
  std::filesystem::path make_again(std::string_view path, const std::filesystem::path& into,
                                   const std::function<void(double share)>& progress) const;

 private:
  using ArmAndSeed = std::pair<std::size_t, std::uint64_t>;
  struct Sweep {
    std::string address;  ///< "/runs/f2_prr"
    std::string name, version;
    std::filesystem::path file;
    std::vector<RunStore::StoredArm> arms;
    std::map<ArmAndSeed, double> epsilon_m;  ///< NaN: the run failed
  };
  struct Found {
    const Sweep* sweep;
    ArmAndSeed run;
  };
  static Sweep read(const std::filesystem::path& folder, const std::filesystem::path& database);
  std::optional<Found> find(std::string_view path) const;

  std::vector<Sweep> sweeps_;
};

/// Site of `tether view FOLDER`: the report of a folder of sweeps, and each of its runs.
///
///     GET  /                          report.html, with a mark that points can be opened
///     GET  /NAME.csv, .gp, .pdf, .png, .svg, .tex    a file beside it, to which it links
///     GET  /runs/[SWEEP/]ARM/SEED     the run as one page; while there is none, one that waits
///     POST the same                   {"state": "waiting", "in work", "ready" or "failed",
///                                     "share": 0 to 1, "error": text}; begins to compute it
///
/// Other paths, and runs that are not in the databases, are not there. A page of another site can
/// begin nothing: browsers say with each POST from where it comes (access.hpp).
class ReportSite {
 public:
  /// `page`: the page of tether view. Throws UsageError if the folder has no report, or no sweep.
  ReportSite(const std::filesystem::path& folder, const std::filesystem::path& page);

  /// For any thread; a WebSite.
  WebAnswer answer(bool is_post, std::string_view path);

 private:
  WebAnswer report() const;
  std::optional<WebAnswer> file(std::string_view path) const;
  std::string make(const std::string& path, const MadePages::Progress& progress) const;

  std::filesystem::path report_;
  PageFolder page_;
  std::string waiting_;  ///< HTML
  SweepRuns runs_;
  MadePages pages_;
};

}  // namespace tether
