#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "tools/experiment/report/claims.hpp"
#include "tools/experiment/report/risk.hpp"
#include "tools/experiment/report/tables.hpp"
#include "tools/experiment/sweep/run_store.hpp"

namespace tether {

/// One sweep in a report.
struct ReportSection {
  std::string name;
  std::string title;
  std::string version, plant, seeds, scenario;
  double wall_time_s = 0.0;
  std::size_t runs = 0, planned = 0, failed = 0;
  bool is_complete = false;
  bool is_common = true;  ///< the arms share seeds: without, nothing is compared
  std::string overrides;  ///< overrides of the experiment file: "--set" of the command; empty: none
  std::string figure;     ///< stem of its files in the report's folder; empty: none
  std::string chart;      ///< chart_json(); empty: none
  /// A head and a row an arm: mean with interval, sd, median, quantiles, n; and the difference to
  /// the first arm on the same seeds.
  std::vector<std::vector<std::string>> table;
  std::vector<SweepTable> tables;        ///< tables that the experiment requests
  std::vector<std::string> table_files;  ///< file of each table, in the report's folder
};

/// Content of a report.
struct Report {
  std::string title;
  std::vector<ReportSection> sections;
  std::vector<Claim> claims;
};

/// One file with everything in it, for any browser, offline; figures from `folder`, the scripts of
/// charts from the programs' share folder.
std::string to_html(const Report& report, const std::filesystem::path& folder);
/// The same for reading as text; figures by name.
std::string to_markdown(const Report& report);

/// Reports on all sweeps of a folder: its own runs.sqlite, or those of its subfolders, by name.
/// Writes report.html, report.md, the figures and the tables' .csv into the folder and returns what
/// they say; claims are judged where the sweeps have the names of the paper's (f2_prr, f3_delay,
/// f4_tau, f5_risk), and the report says which of these were overridden or are not complete; of
/// several sweeps with one name none is judged, and figures are named after their folders. Throws
/// UsageError if there is no sweep.
Report write_report(const std::filesystem::path& folder, RiskDefinition risk);

}  // namespace tether
