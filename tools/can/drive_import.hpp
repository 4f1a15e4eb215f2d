#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/can/eds.hpp"

namespace tether {

/// A drivetrain file of profile "cia402" as far as a data sheet can tell. What it cannot tell is a
/// comment "MISSING" in the text, at its place, and a line of `missing`; no value is guessed, so
/// that the file is refused until they are filled in.
struct DriveSkeleton {
  std::string text;
  std::vector<std::string> missing;
};

/// `nodes`: CANopen node ids of the left and the right drive, equal for one drive with two axes;
/// empty: of a DCF its own and the next, else 1 and 2. A device whose objects are there a second
/// time at +0x800 has two axes.
DriveSkeleton drive_skeleton(const EdsFile& eds, const std::string& file,
                             const std::vector<std::int64_t>& nodes);

}  // namespace tether
