#pragma once

#include <string>
#include <vector>

namespace tether {

/// netem/stages/delay_law.hpp: what is added to the model's delay. The sum is never negative.
struct JitterSettings {
  std::string law = "none";  ///< the name of one of jitter_laws()
  double mean_ms = 0.0;
  double sd_ms = 0.0;            ///< standard deviation
  double shape = 3.0;            ///< pareto, paretonormal: tail index; as in tc's table
  std::vector<double> table_ms;  ///< table: quantiles at equally spaced probabilities 0 … 1
  std::string file;              ///< table: instead, a file of observed delays in ms, one a line
  double correlation = 0.0;      ///< correlation of the normal scores of successive packets

  bool on() const { return law != "none"; }
  bool operator==(const JitterSettings&) const = default;
};

/// A jitter law as tc has it.
struct TcJitter {
  double jitter_ms = 0.0;
  std::string distribution = {};  ///< "": uniform on T ± J
  std::string note = {};
  std::string missing = {};  ///< why there is none
};

/// One of the values of jitter.law, as a row in jitter_laws.cpp: the single place that knows its
/// name and what it does.
struct JitterLaw {
  /// How DelayLaw has it: as its mean, as mean and standard deviation of a normal law, as a table
  /// over normal scores, or as a table over probabilities.
  enum class Form { constant, normal, scores, quantiles };

  std::string name;
  std::vector<std::string> keys;  ///< keys of [jitter] that it uses in addition to `law`
  Form form = Form::constant;
  /// scores: x(z) (netem/stages/delay_law.hpp) at equal steps of z over ±kMaxScore, for sd_s > 0;
  /// seconds.
  std::vector<double> (*tabulate)(const JitterSettings&, double mean_s, double sd_s) = nullptr;
  /// Why the settings that it uses do not make a law; {0} stands for the keys' prefix. "" if they
  /// do. sd_ms > 0 is seen to already.
  std::string (*refusal)(const JitterSettings&) = nullptr;
  TcJitter (*tc)(const JitterSettings&) = nullptr;  ///< must be given if it is not constant

  bool uses(const std::string& key) const;
};

/// All laws, in the order in which messages name them.
const std::vector<JitterLaw>& jitter_laws();
const JitterLaw& jitter_law(const JitterSettings& settings);

}  // namespace tether
