#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <map>
#include <memory>
#include <sstream>
#include <string>

#include "common/base/input_file.hpp"
#include "common/base/text.hpp"
#include "common/program/cli.hpp"
#include "tools/base/text_output.hpp"
#include "tools/cli/netem/netem_commands.hpp"
#include "tools/netem/import.hpp"

namespace tether {
namespace {

struct ImportOptions {
  std::string file;
  std::string format;
  ImportColumns columns;
  double interval_s = 1.0;
  GapRule gaps;
  std::string out;
};

int import(const ImportOptions& options) {
  const std::string text = read_input(options.file, "the measurement", kMostTableBytes);
  const std::string format = options.format.empty() ? format_of_measurement(text) : options.format;
  std::istringstream in(text);
  Imported imported = format == "ping"     ? import_ping(in, options.file, options.interval_s)
                      : format == "iperf3" ? import_iperf3(text, options.file)
                                           : import_csv(in, options.file, options.columns);
  apply(options.gaps, imported, options.file);
  TextOutput out(options.out);
  out.write(to_trace_csv(imported, fmt::format("{}, read as {}", printable(options.file), format)));
  out.close();
  if (options.out.empty()) return kExitOk;
  fmt::print("{}: {} row{} over {:g} s, read as {}\n", options.out, imported.rows.size(),
             imported.rows.size() == 1 ? "" : "s", imported.rows.back().time_s, format);
  for (const std::string& note : imported.notes) fmt::print("{}\n", note);
  return kExitOk;
}

}  // namespace

void add_netem_import_command(CLI::App& netem, Action& action) {
  auto options = std::make_shared<ImportOptions>();
  CLI::App* const command =
      netem.add_subcommand("import",
                           "Convert measurements to a trace (channel.model = \"trace\"): a CSV "
                           "file with any columns, or the output of ping or iperf3");
  command->add_option("file", options->file, "what was measured")->required();
  command->add_option("--format", options->format, "csv, ping or iperf3 [detected from the file]")
      ->check(CLI::IsMember({"csv", "ping", "iperf3"}));
  command->add_option(
      "--time", options->columns.time,
      "CSV: column of the times, NAME:UNIT: ns, us, ms, s or iso (2026-11-26T15:04:05Z) [by "
      "its name]");
  command->add_option("--delay", options->columns.delay,
                      "CSV: column of the delays, NAME:UNIT: ns, us, ms or s; not a number where "
                      "the packet was lost [by its name]");
  command->add_option("--loss", options->columns.loss,
                      "CSV: column of the losses, NAME:UNIT: lost (0 or 1), share, percent, prr or "
                      "prr_percent [by its name]");
  command->add_flag("--round-trip", options->columns.round_trip,
                    "CSV: delays are round-trip times, of which half is used [if the column is "
                    "called rtt or ping]");
  command
      ->add_option("--interval", options->interval_s,
                   "ping without -D: interval between packets, s")
      ->check(number_between(1e-4, 3600.0))
      ->capture_default_str();
  command
      ->add_option("--gaps", options->gaps.meaning,
                   "meaning of a time without rows: hold (the row before), lost (nothing passes) "
                   "or refuse [hold]")
      ->transform(CLI::CheckedTransformer(
          std::map<std::string, GapRule::Meaning>{{"hold", GapRule::Meaning::hold},
                                                  {"lost", GapRule::Meaning::lost},
                                                  {"refuse", GapRule::Meaning::refuse}}));
  command
      ->add_option("--gap", options->gaps.longer_than_s,
                   "minimum length of such a time, s [10 times the usual interval]")
      ->check(number_between(1e-6, 1e6));
  command->add_option("--out", options->out, "file to write [standard output]");
  command->callback([options, &action] { action = [options] { return import(*options); }; });
}

}  // namespace tether
