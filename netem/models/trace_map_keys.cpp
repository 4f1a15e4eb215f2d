#include "netem/models/link_keys.hpp"

namespace tether {
namespace {

constexpr Range kPosition{-1e6, 1e6, false};  // m, dB, ms

void add_trace_keys(KeyTable<LinkConfig>& t) {
  using Interpolation = TraceConfig::Interpolation;
  using AtEnd = TraceConfig::AtEnd;
  t.file("trace.file", TETHER_MEMBER(trace.file),
         "CSV of recorded conditions: time_s, delay_ms, prr or lost");
  t.choice<Interpolation>("trace.interpolation", TETHER_MEMBER(trace.interpolation),
                          {{"step", Interpolation::step}, {"linear", Interpolation::linear}},
                          "between rows");
  t.choice<AtEnd>("trace.at_end", TETHER_MEMBER(trace.at_end),
                  {{"hold", AtEnd::hold}, {"loop", AtEnd::loop}}, "after the last row");
  t.optional_number("trace.start_s", TETHER_MEMBER(trace.start_s), {-4e9, 4e9, false},
                    "the trace's time at the run's start; its first row's if not given");
}

void add_map_keys(KeyTable<LinkConfig>& t) {
  t.file("map.file", TETHER_MEMBER(map.file), "Esri ASCII raster of SNR in dB; or ...");
  t.rows("map.access_points", TETHER_MEMBER(map.access_points), kPosition,
         "... [[x_m, y_m], ...] or [[x_m, y_m, snr_1m_db], ...]");
  t.number("map.snr_1m_db", TETHER_MEMBER(map.snr_1m_db), {-200.0, 300.0, false},
           "access points: SNR at a distance of 1 m");
  t.number("map.path_loss_exponent", TETHER_MEMBER(map.path_loss_exponent), {0.0, 10.0, false},
           "access points: SNR falls by 10 times this per decade of distance");
  t.number("map.handover_s", TETHER_MEMBER(map.handover_s), {0.0, 1e3, false},
           "access points: nothing gets through for so long after a change");
  t.number("map.shadowing_sd_db", TETHER_MEMBER(map.shadowing_sd_db), {0.0, 50.0, false},
           "standard deviation of log-normal shadowing; 0 = none");
  t.number("map.shadowing_distance_m", TETHER_MEMBER(map.shadowing_distance_m), {1e-3, 1e6, false},
           "distance at which the shadowing's correlation is 1/e");
  t.number("map.snr50_db", TETHER_MEMBER(map.snr50_db), {-200.0, 300.0, false},
           "SNR at which half of the packets get through");
  t.number("map.slope_db", TETHER_MEMBER(map.slope_db), {1e-3, 100.0, false},
           "prr = 1/(1 + exp(-(snr - snr50_db)/slope_db))");
  t.rows("map.prr_curve", TETHER_MEMBER(map.prr_curve), kPosition,
         "instead of the two: [[snr_db, prr], ...], linear between");
  t.number("map.delay_ms", TETHER_MEMBER(map.delay_ms), {0.0, 1e6, false}, "delay everywhere");
  t.rows("map.delay_curve", TETHER_MEMBER(map.delay_curve), kPosition,
         "instead: [[snr_db, delay_ms], ...], linear between");
}

}  // namespace

void add_trace_and_map_keys(KeyTable<LinkConfig>& t) {
  add_trace_keys(t);
  add_map_keys(t);
}

}  // namespace tether
