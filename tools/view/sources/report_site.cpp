#include "tools/view/sources/report_site.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "common/base/errors.hpp"
#include "common/base/input_file.hpp"
#include "common/base/share.hpp"
#include "common/base/text.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/version.hpp"
#include "tools/base/json.hpp"
#include "tools/base/replacing_output.hpp"
#include "tools/base/temporary_folder.hpp"
#include "tools/experiment/sweep/sweeps_below.hpp"
#include "tools/nodes/closed_loop.hpp"
#include "tools/runs/output_folder.hpp"
#include "tools/runs/run_observer.hpp"
#include "tools/runs/run_summary.hpp"
#include "tools/view/sources/gzip.hpp"
#include "tools/view/sources/log_view.hpp"
#include "tools/view/sources/one_file_page.hpp"
#include "tools/view/sources/recording.hpp"

namespace tether {
namespace {

/// The work is not wanted any more.
struct GivenUp {};

}  // namespace

MadePages::MadePages(Make make)
    : make_(std::move(make)), worker_([this](const std::stop_token& stop) { work(stop); }) {}

MadePage MadePages::ask(const std::string& name) {
  const std::lock_guard lock(mutex_);
  if (const auto found = pages_.find(name); found != pages_.end()) return found->second;
  if (waiting_.size() >= kMostWaiting) {
    return {.state = MadePage::State::failed,
            .error = "too many runs are waiting to be computed: try again later"};
  }
  waiting_.push_back(name);
  asked_.notify_one();
  return pages_[name];
}

std::shared_ptr<const std::string> MadePages::find(const std::string& name) const {
  const std::lock_guard lock(mutex_);
  const auto found = pages_.find(name);
  return found == pages_.end() ? nullptr : found->second.page;
}

void MadePages::work(const std::stop_token& stop) {
  for (;;) {
    std::string name;
    {
      std::unique_lock lock(mutex_);
      if (!asked_.wait(lock, stop, [this] { return !waiting_.empty(); })) return;
      name = std::move(waiting_.front());
      waiting_.pop_front();
      pages_[name].state = MadePage::State::in_work;
    }
    try {
      finish(name, made(name, stop));
    } catch (const GivenUp&) {
      return;
    }
  }
}

MadePage MadePages::made(const std::string& name, const std::stop_token& stop) {
  const Progress tell = [&](double share) {
    if (stop.stop_requested()) throw GivenUp();
    const std::lock_guard lock(mutex_);
    pages_[name].share = share;
  };
  try {
    return {.state = MadePage::State::ready,
            .share = 1.0,
            .page = std::make_shared<const std::string>(make_(name, tell))};
  } catch (const std::exception& error) {
    return {.state = MadePage::State::failed, .error = error.what()};
  }
}

void MadePages::finish(const std::string& name, MadePage page) {
  const std::lock_guard lock(mutex_);
  pages_[name] = std::move(page);
  kept_.push_back(name);
  if (kept_.size() <= kMostKept) return;
  pages_.erase(kept_.front());
  kept_.pop_front();
}

namespace {

namespace fs = std::filesystem;

/// Between two machines, of the last digits.
bool is_same(double a, double b) { return std::abs(a - b) <= 1e-9 * std::max(1.0, std::abs(b)); }

/// Parses "/runs/4/17": "/runs/4" and 17; nothing if there is no number.
template <class Number>
std::optional<std::pair<std::string_view, Number>> split_number(std::string_view path) {
  const std::size_t slash = path.rfind('/');
  if (slash == std::string_view::npos) return std::nullopt;
  const auto number = to_number<Number>(path.substr(slash + 1));
  if (!number) return std::nullopt;
  return std::pair{path.substr(0, slash), *number};
}

/// Computes the run and records it; returns its ε.
double record_run(const Scenario& scenario, const fs::path& log,
                  const std::function<void(double share)>& progress) {
  ClosedLoop loop(scenario);
  const RunObserver observer(scenario, loop.loop(), loop.bus());
  EventLogWriter writer(log, loop.loop(), loop.bus());
  const Instant end = kStart + from_seconds(scenario.get<RunSettings>().duration_s);
  for (Instant t = kStart; t < end; t = std::min(end, t + std::chrono::seconds{1})) {
    loop.run_until(t);
    progress(to_seconds(t) / to_seconds(end));
  }
  loop.run();
  check_finite(observer);
  writer.close();
  return observer.truth().epsilon_m;
}

}  // namespace

SweepRuns::SweepRuns(const fs::path& folder) {
  for (const fs::path& database : databases_below(folder)) {
    sweeps_.push_back(read(folder, database));
  }
}

SweepRuns::Sweep SweepRuns::read(const fs::path& folder, const fs::path& database) {
  const RunStore store = RunStore::open(database);
  Sweep sweep{.address = "/" + address_of_runs(folder, database),
              .name = store.name(),
              .version = store.version(),
              .file = database,
              .arms = store.arms(),
              .epsilon_m = {}};
  const std::size_t epsilon = metric_number("epsilon_m").value();
  store.for_each([&](const StoredRun& run) {
    const bool failed = !run.result.failure.empty() || run.arm >= sweep.arms.size();
    sweep.epsilon_m[{run.arm, run.seed}] =
        failed ? std::numeric_limits<double>::quiet_NaN() : run.result.metrics[epsilon];
  });
  return sweep;
}

std::optional<SweepRuns::Found> SweepRuns::find(std::string_view path) const {
  const auto by_seed = split_number<std::uint64_t>(path);
  if (!by_seed) return std::nullopt;
  const auto by_arm = split_number<std::size_t>(by_seed->first);
  if (!by_arm) return std::nullopt;
  const ArmAndSeed run{by_arm->second, by_seed->second};
  for (const Sweep& sweep : sweeps_) {
    if (sweep.address == by_arm->first && sweep.epsilon_m.contains(run)) return Found{&sweep, run};
  }
  return std::nullopt;
}

fs::path SweepRuns::make_again(std::string_view path, const fs::path& into,
                               const std::function<void(double share)>& progress) const {
  const Found found = find(path).value();
  const Sweep& sweep = *found.sweep;
  const auto [arm, seed] = found.run;
  const auto fail = [&, arm = arm, seed = seed](const std::string& why) {
    throw std::runtime_error(fmt::format(
        "arm {}, seed {} of {} cannot be made again: {} (made by tether {}; this is tether {})",
        arm, seed, sweep.file.string(), why, sweep.version, kVersion));
  };
  fs::path log = into / fmt::format("{}-arm{}-seed{}.lcmlog",
                                    fs::path(sweep.name).filename().string(), arm, seed);
  double epsilon_m = 0.0;
  try {
    Scenario scenario =
        with_absolute_names(parse_scenario(sweep.arms.at(arm).scenario, sweep.file.string()));
    scenario.get<RunSettings>().seed = seed;
    write_file(into / "scenario.toml", to_toml(scenario));
    epsilon_m = record_run(scenario, log, progress);
  } catch (const std::exception& error) {
    fail(error.what());
  }
  const double then_m = sweep.epsilon_m.at(found.run);
  if (!is_same(epsilon_m, then_m)) {
    fail(fmt::format("its ε comes to {} m, where the sweep has {} m", epsilon_m, then_m));
  }
  return log;
}

namespace {

namespace fs = std::filesystem;

constexpr std::uintmax_t kMostReportBytes = std::uintmax_t{256} << 20;
constexpr char kHtml[] = "text/html; charset=utf-8";
/// All is within the file: reports, the page of a run and the one that waits for it; the last asks.
constexpr char kReportPolicy[] =
    "default-src 'none'; script-src 'unsafe-inline' data:; style-src 'unsafe-inline' data:; "
    "img-src "
    "data: blob:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

WebAnswer page_answer(std::string html) { return {200, std::move(html), kHtml, kReportPolicy}; }

std::string state_json(const MadePage& page) {
  constexpr std::array kStates{"waiting", "in work", "ready", "failed"};
  nlohmann::ordered_json state{{"state", kStates.at(static_cast<std::size_t>(page.state))},
                               {"share", page.share}};
  if (!page.error.empty()) state["error"] = page.error;
  return json_text(state);
}

}  // namespace

ReportSite::ReportSite(const fs::path& folder, const fs::path& page)
    : report_(folder / "report.html"),
      page_(page),
      waiting_(
          read_input(shared_file("swept/page/waiting.html").string(), "a page", kMostReportBytes)),
      runs_(folder),
      pages_([this](const std::string& path, const MadePages::Progress& progress) {
        return make(path, progress);
      }) {
  if (fs::is_regular_file(report_)) return;
  throw UsageError(
      fmt::format("{0} has no report.html: make it by tether report {0}", folder.string()));
}

WebAnswer ReportSite::answer(bool is_post, std::string_view path) {
  if (path == "/" || path == "/report.html") {
    return is_post ? WebAnswer{405, "the report takes GET and HEAD\n"} : report();
  }
  if (auto beside = is_post ? std::nullopt : file(path)) return std::move(*beside);
  if (!runs_.has(path)) return {404, "this report has no such run\n"};
  const std::string name(path);
  if (is_post) return {200, state_json(pages_.ask(name)), "application/json"};
  const auto made = pages_.find(name);
  return page_answer(made ? *made : waiting_);
}

std::optional<WebAnswer> ReportSite::file(std::string_view path) const {
  static const std::map<std::string, std::string> kTypes{
      {".csv", "text/csv; charset=utf-8"}, {".gp", "text/plain; charset=utf-8"},
      {".pdf", "application/pdf"},         {".png", "image/png"},
      {".svg", "image/svg+xml"},           {".tex", "text/plain; charset=utf-8"}};
  const std::string name(path.substr(path.starts_with('/') ? 1 : 0));
  const auto type = kTypes.find(fs::path(name).extension().string());
  const fs::path beside = report_.parent_path() / name;
  // Names alone: nothing of other folders.
  if (type == kTypes.end() || name.find('/') != std::string::npos || !fs::is_regular_file(beside)) {
    return std::nullopt;
  }
  try {
    return WebAnswer{200, read_input(beside.string(), "a file of the report", kMostReportBytes),
                     type->second};
  } catch (const std::exception&) {
    return std::nullopt;  // gone meanwhile
  }
}

/// Its present content: it may have been written again.
WebAnswer ReportSite::report() const {
  try {
    std::string html = read_input(report_.string(), "the report", kMostReportBytes);
    constexpr std::string_view kPlace = "<html";
    const std::size_t found = html.find(kPlace);
    if (found != std::string::npos) html.insert(found + kPlace.size(), " data-served");
    return page_answer(std::move(html));
  } catch (const std::exception& error) {
    return {404, fmt::format("{}\n", error.what())};
  }
}

std::string ReportSite::make(const std::string& path, const MadePages::Progress& progress) const {
  const TemporaryFolder folder;
  ViewedLog log(runs_.make_again(path, folder.path(), progress).string());
  return one_file_page(files_of(page_), base64(gzip(record(log, {}).text)));
}

}  // namespace tether
