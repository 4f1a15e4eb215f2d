#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "tools/view/swept/made_pages.hpp"
#include "tools/view/swept/sweep_runs.hpp"
#include "tools/view/web/page_folder.hpp"
#include "tools/view/web/web_site.hpp"

namespace tether {

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
