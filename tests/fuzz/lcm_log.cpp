#include <sstream>

#include "tests/fuzz/fuzz.hpp"
#include "tools/log/log_survey.hpp"
#include "tools/log/mcap_export.hpp"
#include "tools/messages/event_log.hpp"
#include "tools/messages/message_printer.hpp"
#include "tools/netem/fit.hpp"

namespace tether::fuzzing {

/// A log is read to its end, whatever it holds: each byte is of a record or of damage.
void try_input(std::span<const std::uint8_t> input) {
  std::istringstream in(text_of(input));
  EventLogReader reader(in);
  reader.looks_like_log();
  std::uint64_t accounted = 0;
  LoggedEvent event;
  while (reader.next(event)) {
    accounted += EventLogReader::kHeaderBytes + event.channel.size() + event.data.size();
    format_message(event.channel, inspect_message(event.data));
  }
  for (const LogDamage& damage : reader.damage()) accounted += damage.size_bytes;
  must(accounted == input.size(), "each byte is of a record or of damage");

  // The export to MCAP accounts for each event.
  for (const bool ros2 : {false, true}) {
    std::istringstream first(text_of(input)), second(text_of(input));
    EventLogReader surveyed(first), exported(second);
    const LogSurvey survey = survey_log(surveyed);
    const auto report = export_mcap(exported, survey, {ros2, {}, ""}, [](std::string_view) {});
    must(report.events == survey.events, "the same events twice");
    must(report.converted + report.left_out.count() == report.events, "each is taken or left out");
  }

  std::istringstream again(text_of(input));
  takes<std::runtime_error>([&] { read_fit_log(again, "run.lcmlog", ""); });
}

}  // namespace tether::fuzzing
