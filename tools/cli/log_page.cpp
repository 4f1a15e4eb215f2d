#include "tools/cli/log_page.hpp"

#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <string>

#include "common/base/errors.hpp"
#include "common/program/cli.hpp"
#include "common/program/cli_range.hpp"
#include "tools/base/replacing_output.hpp"
#include "tools/base/text_output.hpp"
#include "tools/cli/log_out.hpp"
#include "tools/cli/view_options.hpp"
#include "tools/view/one_file/gzip.hpp"
#include "tools/view/one_file/one_file_page.hpp"
#include "tools/view/one_file/recording.hpp"
#include "tools/view/web/page_folder.hpp"

namespace tether {
namespace {

namespace fs = std::filesystem;

struct PageOptions {
  std::string file;
  std::string out;
  std::string page;
  RecordedSpan span;
};

/// Largest page that can still be mailed and opens quickly.
constexpr std::size_t kMostPageBytes = 30'000'000;

int log_page(PageOptions options) {
  if (options.out.empty()) options.out = log_out_beside(options.file, ".html");
  check_log_out(options.file, options.out);
  if (!(options.span.from_s <= options.span.to_s)) {
    throw UsageError(
        fmt::format("--from {} has to be before --to {}", options.span.from_s, options.span.to_s));
  }
  ViewedLog log(options.file);
  const PageFolder folder(options.page.empty() ? shared_page() : fs::path(options.page));
  const Recording recording = record(log, options.span);
  const std::string html = one_file_page(files_of(folder), base64(gzip(recording.text)));
  if (html.size() > kMostPageBytes) {
    throw UsageError(fmt::format(
        "{}: the page would have {:.1f} MB, more than {:.0f} MB: name a part of the log by --from "
        "and --to, or use tether view, which plays any length",
        options.file, static_cast<double>(html.size()) * 1e-6,
        static_cast<double>(kMostPageBytes) * 1e-6));
  }
  ReplacingOutput out(options.out);
  out.write(html);
  out.close();
  TextOutput said;
  said.write(
      fmt::format("{}: {} messages, {} bytes\n", options.out, recording.messages, html.size()));
  said.close();
  for (const std::string& note : log.notes()) fmt::print(stderr, "{}: {}\n", options.file, note);
  for (const std::string& line : recording.left_out.lines()) {
    fmt::print(stderr, "{}: left out {}\n", options.file, line);
  }
  return kExitOk;
}

}  // namespace

void add_log_page_command(CLI::App& log, Action& action) {
  auto options = std::make_shared<PageOptions>();
  CLI::App* const page = log.add_subcommand(
      "page",
      "Export the page of tether view with the log in it: one HTML file, for any browser, offline");
  page->add_option("file", options->file, "LCM event log")->required();
  page->add_option("--out", options->out, "file to write [the log's name with .html]");
  page->add_option("--from", options->span.from_s, "first second to include [all]")
      ->check(number_between(-1e12, 1e12));
  page->add_option("--to", options->span.to_s, "last second to include [all]")
      ->check(number_between(-1e12, 1e12));
  page->add_option("--page", options->page,
                   "folder with the page's files [share/tether/view beside bin]");
  page->callback([options, &action] { action = [options] { return log_page(*options); }; });
}

}  // namespace tether
