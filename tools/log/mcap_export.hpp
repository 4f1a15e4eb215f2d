#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "tools/log/log_survey.hpp"
#include "tools/log/mcap_writer.hpp"
#include "tools/log/scene_setting.hpp"

namespace tether {

/// How an LCM event log becomes MCAP.
struct McapExport {
  bool ros2 = false;     ///< a ROS 2 bag; else JSON for Foxglove
  SceneSetting setting;  ///< the scene according to the log's scenario
  std::string library;   ///< who wrote it, for the file's header
};

struct McapExportReport {
  std::int64_t events = 0;     ///< events in the log
  std::int64_t converted = 0;  ///< number of converted ones
  std::uint64_t messages = 0;  ///< messages in the MCAP file: more, with those for viewers
  std::uint64_t bytes = 0;     ///< size of the MCAP file
  std::int64_t shift_us = 0;   ///< added to all times, for MCAP has none below 0
  LeftOut left_out;
  std::vector<LogDamage> damage;
};

/// Converts what `log` has. With JSON each LCM channel is one of the same name (schema
/// "tether.pose_t" …, message_schema.hpp), and channels VIEW/… make the run visible
/// (scene_view.hpp). As a ROS 2 bag it has topics with CDR (ros2_conversion.hpp). Times are the
/// log's; `sequence` is the message's seq. Of a log with times below 0 (run.lead_s), all times are
/// moved up by whole seconds. Metadata "tether" says so, and what was left out.
/// `survey` is of the same log. Equal logs give equal bytes.
McapExportReport export_mcap(EventLogReader& log, const LogSurvey& survey,
                             const McapExport& options, const McapWriter::Sink& sink);

}  // namespace tether
