#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <limits>
#include <string>
#include <tether/link_report_t.hpp>
#include <vector>

#include "common/path/reference_path.hpp"
#include "common/scenario/scenario.hpp"
#include "tools/runs/run_observer.hpp"

namespace tether {

/// A square of the floor from above in a terminal, north (y) up: a cell has two by four Braille
/// dots (Unicode U+2800 to U+28FF), which are about as far apart across as along. Pure.
class BrailleMap {
 public:
  /// `rows` lines of twice as many columns; the world is x and y in ±half_extent_m.
  BrailleMap(int rows, double half_extent_m);

  /// Dots beyond the edge are left out. A faint one leaves a cell bright that is.
  void faint_dot(double x_m, double y_m) { dot(x_m, y_m, false); }
  void bright_dot(double x_m, double y_m) { dot(x_m, y_m, true); }
  /// An arrow in bold, in the one of eight directions that is nearest to `yaw_rad`; at the edge if
  /// it is beyond.
  void arrow(double x_m, double y_m, double yaw_rad);

  /// From north to south, each 2 `rows` columns wide with escape sequences (SGR) for faint and
  /// bold.
  std::vector<std::string> lines() const;

 private:
  struct Cell {
    std::uint8_t dots = 0;
    bool bright = false;
    const char* symbol = nullptr;
  };
  void dot(double x_m, double y_m, bool bright);

  int rows_;
  double half_extent_m_;
  std::vector<Cell> cells_;  ///< by rows, the northernmost first
};

/// Statistics of a direction of the relay over the last seconds: its reports count since its start.
/// Pure.
class RecentLink {
 public:
  static constexpr double kWindow_s = 10.0;  ///< a few messages, where one is sent a second

  struct Seen {
    double prr = std::numeric_limits<double>::quiet_NaN();       ///< NaN: nothing was sent
    double delay_ms = std::numeric_limits<double>::quiet_NaN();  ///< mean; NaN: nothing arrived
    double per_s = 0.0;                                          ///< messages heard
  };

  /// The newest report at `t_s`, which rises, and how many messages have been heard so far. A
  /// restarted relay resets them.
  void add(double t_s, const link_report_t& report, std::int64_t heard);
  Seen seen() const;

 private:
  struct Count {
    double t_s;
    std::int64_t offered, missing, delivered, heard;
    double delays_ms;  ///< their sum
  };
  std::deque<Count> counts_;
};

/// Status lines at the end of a terminal (standard error) that change in place while a program
/// runs; lines that are said meanwhile stay above it. Without a terminal only these are written.
class TerminalStatus {
 public:
  /// `wanted`: false for lines only, whatever standard error is.
  explicit TerminalStatus(bool wanted);

  bool shown() const { return shown_; }
  /// Whether the terminal, as large as it is now, has room for so much and the line below it.
  bool has_room(int columns, int rows) const;

  /// Replaces the status, over what stands there, which is not taken away first: it would flicker.
  /// What does not fit into a row is cut off: a line that wraps would stay.
  void show(const std::vector<std::string>& lines);
  /// Writes a line that stays.
  void say(const std::string& line);
  /// Takes the status away.
  void clear();

  /// Text that makes a terminal write `lines` over a status of `before` lines. Pure.
  static std::string rewritten(std::size_t before, const std::vector<std::string>& lines);

 private:
  std::string erasure() const;

  bool shown_;
  std::vector<std::string> lines_;
};

/// How a live run is going, for a terminal; of a fleet as a whole, and of its first vehicle. Pure.
class Dashboard {
 public:
  static constexpr int kColumns = 79, kRows = 17;

  /// Values that an observer of the run does not have.
  struct Moment {
    double t_s = 0.0;
    RecentLink::Seen uplink, downlink;  ///< in the last seconds
    std::vector<std::string> fleet;     ///< fleet_now()
    std::vector<Position> others;       ///< where the fleet's other vehicles are
    std::string drives;                 ///< state of the drives on CAN; empty: there are none
    std::vector<std::string> findings;  ///< reasons why the run is invalid
    std::vector<std::string> silent;    ///< silent programs, and for how long
  };

  /// `scenario`: the first vehicle's.
  explicit Dashboard(const Scenario& scenario);

  /// In one line of fewer than 80 columns, but for what is wrong: the time that is left, where the
  /// vehicle is, its error now, reception ratio and mean delay of the last seconds each way, the
  /// drives; of a fleet the time and how it stands.
  std::string line(const RunObserver& run, const Moment& moment) const;
  /// All beside a map: the path faint, the way of the last 20 s, the vehicle as an arrow, the
  /// fleet's others as dots. At most kRows lines of at most kColumns columns.
  std::vector<std::string> lines(const RunObserver& run, const Moment& moment) const;

 private:
  double left_s(const Moment& moment) const;
  std::string map_title() const;
  std::vector<std::string> map(const RunObserver& run, const Moment& moment) const;
  std::vector<std::string> facts(const RunObserver& run, const Moment& moment) const;

  std::string name_;
  double duration_s_;
  double half_extent_m_;  ///< half extent of the map
  std::vector<Position> path_;
};

}  // namespace tether
