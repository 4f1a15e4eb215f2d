#include "tools/log/csv_export.hpp"

#include <fmt/format.h>

#include <map>
#include <set>

#include "common/base/text.hpp"
#include "tools/base/text_output.hpp"

namespace tether {
namespace {

struct OpenTable {
  OpenTable(const MessageType& of, const std::filesystem::path& folder, const std::string& name)
      : type(&of), file(name), out((folder / name).string()) {}

  const MessageType* type;
  std::string file;
  TextOutput out;
  std::int64_t rows = 0;
};

std::string file_name(std::string_view channel, std::set<std::string>& taken) {
  std::string stem;
  for (const char c : channel) {
    const bool fits = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                      c == '-' || (c == '.' && !stem.empty());
    stem += fits ? c : '_';
    if (stem.size() >= 200) break;  // the longest names that file systems take have 255 bytes
  }
  std::string name = stem + ".csv";
  for (int i = 2; !taken.insert(name).second; ++i) name = fmt::format("{}_{}.csv", stem, i);
  return name;
}

}  // namespace

std::string csv_row(std::int64_t timestamp_us, const MessageContent& message) {
  const bool negative = timestamp_us < 0;
  const std::uint64_t us = negative ? 0 - static_cast<std::uint64_t>(timestamp_us)
                                    : static_cast<std::uint64_t>(timestamp_us);
  return fmt::format("{}{}.{:06},{}\n", negative ? "-" : "", us / 1'000'000, us % 1'000'000,
                     csv_values(message.values));
}

CsvExportReport csv_export_all(EventLogReader& log, const std::filesystem::path& folder) {
  CsvExportReport report;
  std::map<std::string, OpenTable, std::less<>> tables;
  std::set<std::string> taken;
  LoggedEvent event;
  while (log.next(event)) {
    const MessageContent message = inspect_message(event.data);
    std::string why = why_unusable(message);
    auto table = tables.find(event.channel);
    if (why.empty() && table == tables.end()) {
      if (tables.size() >= LogSurvey::kMostChannels) {
        why = "beyond the first 1000 channels";
      } else {
        table =
            tables
                .try_emplace(event.channel, *message.type, folder, file_name(event.channel, taken))
                .first;
        table->second.out.write("t_s," + csv_names(*message.type) + "\n");
      }
    }
    if (why.empty() && table->second.type != message.type) {
      why = fmt::format("a {} among {}", message.type->name, table->second.type->name);
    }
    if (!why.empty()) {
      report.left_out.add(event.channel, why);
      continue;
    }
    table->second.out.write(csv_row(event.timestamp_us, message));
    ++table->second.rows;
  }
  for (auto& [channel, table] : tables) {
    table.out.close();
    report.tables.push_back({channel, table.type->name, table.file, table.rows});
  }
  report.damage = log.damage();
  return report;
}

}  // namespace tether
