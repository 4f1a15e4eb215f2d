#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "tools/log/log_survey.hpp"

namespace tether {

/// "1.500000,": the time stamp in seconds, then the values.
std::string csv_row(std::int64_t timestamp_us, const MessageContent& message);

/// One table of csv_export_all().
struct CsvFile {
  std::string channel, type, file;
  std::int64_t rows = 0;
};

struct CsvExportReport {
  std::vector<CsvFile> tables;  ///< by channel
  LeftOut left_out;
  std::vector<LogDamage> damage;
};

/// Writes FOLDER/AGV_POSE.csv and so on, one table for each channel: of the type of its first
/// message that can be decoded; others are left out. In names of files, all but letters, digits,
/// '-' and '.' becomes '_'; where two channels would share one, the later gets "_2". `folder`
/// exists. Throws std::runtime_error if a file cannot be written.
CsvExportReport csv_export_all(EventLogReader& log, const std::filesystem::path& folder);

}  // namespace tether
