#include "tools/view/swept/report_site.hpp"

#include <fmt/format.h>

#include <array>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "common/base/errors.hpp"
#include "common/base/input_file.hpp"
#include "common/base/share.hpp"
#include "tools/base/json.hpp"
#include "tools/base/temporary_folder.hpp"
#include "tools/view/one_file/gzip.hpp"
#include "tools/view/one_file/one_file_page.hpp"
#include "tools/view/one_file/recording.hpp"
#include "tools/view/sources/log_view.hpp"

namespace tether {
namespace {

namespace fs = std::filesystem;

constexpr std::uintmax_t kMostReportBytes = std::uintmax_t{256} << 20;
constexpr char kHtml[] = "text/html; charset=utf-8";
/// All is within the file: reports, the page of a run and the one that waits for it; the last asks.
constexpr char kPolicy[] =
    "default-src 'none'; script-src 'unsafe-inline' data:; style-src 'unsafe-inline' data:; "
    "img-src "
    "data: blob:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

WebAnswer page_answer(std::string html) { return {200, std::move(html), kHtml, kPolicy}; }

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
