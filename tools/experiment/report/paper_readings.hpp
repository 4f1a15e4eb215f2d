#pragma once

namespace tether {

/// A number of the paper, and how accurately its text and figures give it: the band within which a
/// claim about it is reproduced. There is one band a number. It says what can be read there, and
/// was fixed by that alone, not by what comes out here.
struct Band {
  double centre_m, accuracy_m;
  constexpr double low_m() const { return centre_m - accuracy_m; }
  constexpr double high_m() const { return centre_m + accuracy_m; }
};

/// F2: "about 15 m", "up to about 23 m on average", "up to 30 m", on an axis of 30 m and a little
/// more: to a twentieth of it.
inline constexpr double kReadOfF2_m = 1.5;
inline constexpr Band kFewCommands{15.0, kReadOfF2_m};
inline constexpr Band kPlateau{23.0, kReadOfF2_m};
inline constexpr Band kWorstRun{30.0, kReadOfF2_m};

/// F3: from 1.8 to 2.1 m, given to two digits, on an axis that spans little more than these.
inline constexpr double kReadOfF3_m = 0.1;
inline constexpr Band kUnimpaired{1.8, kReadOfF3_m};
inline constexpr Band kAtLongestDelay{2.1, kReadOfF3_m};
/// Rise of F3 from no delay to 500 ms.
inline constexpr Band kRiseWithDelay{0.3, kReadOfF3_m};

/// Not a number of the paper: F2 is nearly down again at PRR 0.85.
inline constexpr double kNearlyDown_m = 2.6;

}  // namespace tether
