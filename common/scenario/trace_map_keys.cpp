#include "common/scenario/channel_keys.hpp"

namespace tether {
namespace {

constexpr Range kPosition{-1e6, 1e6, false};  // m, dB, ms

void add_trace_keys(KeyTable& t, const std::string& trace, const LinkSelect& link) {
  using Interpolation = TraceConfig::Interpolation;
  using AtEnd = TraceConfig::AtEnd;
  t.text(trace + "file", TETHER_LINK(trace.file),
         "CSV of recorded conditions: time_s, delay_ms, prr or lost");
  t.choice<Interpolation>(trace + "interpolation", TETHER_LINK(trace.interpolation),
                          {{"step", Interpolation::step}, {"linear", Interpolation::linear}},
                          "between rows");
  t.choice<AtEnd>(trace + "at_end", TETHER_LINK(trace.at_end),
                  {{"hold", AtEnd::hold}, {"loop", AtEnd::loop}}, "after the last row");
  t.optional_number(trace + "start_s", TETHER_LINK(trace.start_s), {-4e9, 4e9, false},
                    "the trace's time at the run's start; its first row's if not given");
}

void add_map_keys(KeyTable& t, const std::string& map, const LinkSelect& link) {
  t.text(map + "file", TETHER_LINK(map.file), "Esri ASCII raster of SNR in dB; or ...");
  t.rows(map + "access_points", TETHER_LINK(map.access_points), kPosition,
         "... [[x_m, y_m], ...] or [[x_m, y_m, snr_1m_db], ...]");
  t.number(map + "snr_1m_db", TETHER_LINK(map.snr_1m_db), {-200.0, 300.0, false},
           "access points: SNR at a distance of 1 m");
  t.number(map + "path_loss_exponent", TETHER_LINK(map.path_loss_exponent), {0.0, 10.0, false},
           "access points: SNR falls by 10 times this per decade of distance");
  t.number(map + "handover_s", TETHER_LINK(map.handover_s), {0.0, 1e3, false},
           "access points: nothing gets through for so long after a change");
  t.number(map + "shadowing_sd_db", TETHER_LINK(map.shadowing_sd_db), {0.0, 50.0, false},
           "standard deviation of log-normal shadowing; 0 = none");
  t.number(map + "shadowing_distance_m", TETHER_LINK(map.shadowing_distance_m), {1e-3, 1e6, false},
           "distance at which the shadowing's correlation is 1/e");
  t.number(map + "snr50_db", TETHER_LINK(map.snr50_db), {-200.0, 300.0, false},
           "SNR at which half of the packets get through");
  t.number(map + "slope_db", TETHER_LINK(map.slope_db), {1e-3, 100.0, false},
           "prr = 1/(1 + exp(-(snr - snr50_db)/slope_db))");
  t.rows(map + "prr_curve", TETHER_LINK(map.prr_curve), kPosition,
         "instead of the two: [[snr_db, prr], ...], linear between");
  t.number(map + "delay_ms", TETHER_LINK(map.delay_ms), {0.0, 1e6, false}, "delay everywhere");
  t.rows(map + "delay_curve", TETHER_LINK(map.delay_curve), kPosition,
         "instead: [[snr_db, delay_ms], ...], linear between");
}

}  // namespace

void add_trace_and_map_keys(KeyTable& t, const std::string& prefix, const LinkSelect& link) {
  add_trace_keys(t, prefix + "trace.", link);
  add_map_keys(t, prefix + "map.", link);
}

}  // namespace tether
