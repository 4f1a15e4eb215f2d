#include "netem/fit/report.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace tether {
namespace {

const ModelFit& chosen(const ChannelFit& fit) {
  if (fit.choice == ChannelFit::Choice::markov) return *fit.markov;
  return fit.candidates[fit.best];
}

std::string describe(const FitParameter& p) {
  if (p.fixed) return fmt::format("{} = {:g} (set)", p.name, p.value);
  const bool has_interval = p.low > 0.0 || (p.high < 1.0 && p.high > 0.0);
  if (std::isnan(p.standard_error) && has_interval) {
    return fmt::format("{} = {:.4g}, 95 % in {:.4g} … {:.4g}", p.name, p.value, p.low, p.high);
  }
  if (std::isnan(p.standard_error)) {
    return fmt::format("{} = {:.4g} (not determined by this log)", p.name, p.value);
  }
  return fmt::format("{} = {:.4g} ± {:.2g}, 95 % in {:.4g} … {:.4g}", p.name, p.value,
                     p.standard_error, p.low, p.high);
}

std::string describe_model(const ModelFit& model, const ChannelFit& fit, bool is_chosen) {
  std::string text =
      fmt::format("{} {}: ln L {:.2f}, AIC {:.1f}, BIC {:.1f}\n", is_chosen ? "*" : " ", model.name,
                  model.log_likelihood, model.aic(), model.bic(fit.packets));
  for (const FitParameter& p : model.parameters) text += fmt::format("      {}\n", describe(p));
  return text;
}

/// "gilbert_elliott.p = 0.02", with the comment in a column of its own.
std::string line(const std::string& key, double value, const FitParameter* p = nullptr) {
  // Shortest notation that reads back as the same number; TOML wants a decimal point for a float.
  std::string number = fmt::format("{}", value);
  if (number.find_first_of(".e") == std::string::npos) number += ".0";
  std::string text = fmt::format("{} = {}", key, number);
  if (p != nullptr && !p->fixed && !std::isnan(p->standard_error)) {
    text += fmt::format("  # ± {:.2g}", p->standard_error);
  }
  return text + "\n";
}

std::string delay_line(const std::string& key, double delay_s) {
  if (std::isnan(delay_s)) return "";
  return line(key, std::max(0.0, std::round(delay_s * 1e9) * 1e-6));  // to the nanosecond
}

std::string number_list(const std::vector<double>& values_s) {
  std::string text = "[";
  for (std::size_t i = 0; i < values_s.size(); ++i) {
    text += fmt::format("{}{:.6f}", i == 0 ? "" : i % 10 == 0 ? ",\n  " : ", ", values_s[i] * 1e3);
  }
  return text + "]";
}

/// The keys jitter.…
std::string jitter_lines(const DelayFit& fit) {
  if (fit.law() == "none") return "";
  std::string text = fmt::format("jitter.law = \"{}\"\n", fit.law());
  if (fit.law() == "table") {
    text += fmt::format("jitter.table_ms = {}\n", number_list(fit.table_s));
  } else {
    const DelayFit::Candidate& c = fit.candidates[fit.best];
    for (const FitParameter& p : c.parameters) {
      if (p.name != "delay_ms") text += line(p.name, p.value, &p);
    }
  }
  if (fit.correlation != 0.0) {
    text += line("jitter.correlation", std::round(fit.correlation * 1e4) * 1e-4);
  }
  return text;
}

/// Constant part of delays of that mean, without the jitter.
double constant_part(const DelayFit& fit, double mean_s) {
  if (fit.law() == "none") return mean_s;
  const double shift_s = fit.law() == "table" ? 0.0 : fit.candidates[fit.best].constant_s;
  return mean_s + shift_s;
}

std::string markov_lines(const MarkovFit& m) {
  const auto& p = m.parameters;
  return "model = \"markov\"\n" + line("markov.good.prr", m.model.prr_good, &p[0]) +
         delay_line("markov.good.delay_ms", constant_part(m.delays, m.delay_good_s)) +
         line("markov.bad.prr", m.model.prr_bad, &p[1]) +
         delay_line("markov.bad.delay_ms", constant_part(m.delays, m.delay_bad_s)) +
         line("markov.mean_good_s", m.model.mean_good_s, &p[2]) +
         line("markov.mean_bad_s", m.model.mean_bad_s, &p[3]) + jitter_lines(m.delays);
}

/// Lines on the delay of a model that has one delay for all its states.
std::string delay_lines(const DelayFit& fit) {
  const double constant_s = fit.law() == "none" ? fit.mean_s : constant_part(fit, 0.0);
  return delay_line("delay_ms", constant_s) + jitter_lines(fit);
}

std::string describe_delays(const ChannelFit& channel) {
  const bool by_state = channel.choice == ChannelFit::Choice::markov;
  const DelayFit& fit = by_state ? channel.markov->delays : channel.delays;
  if (fit.candidates.empty()) return "";
  std::string text =
      fmt::format("\nDelays{}: {} of them, worth {:.0f} independent ones; ",
                  by_state ? " less the mean of each state" : "", fit.delays, fit.effective);
  text += fit.correlation == 0.0 ? "neighbours are not correlated\n"
                                 : fmt::format("neighbours' correlation {:.3f} ± {:.2g}\n",
                                               fit.correlation, fit.correlation_error);
  for (std::size_t i = 0; i < fit.candidates.size(); ++i) {
    const DelayFit::Candidate& c = fit.candidates[i];
    const bool is_chosen = i == fit.best && fit.table_s.empty();
    text += fmt::format("{} {}: BIC {:.1f}, off by {:.4f} at most, p = {:.3g}\n",
                        is_chosen ? "*" : " ", c.law, c.bic, c.distance, c.p_value);
    if (i != fit.best) continue;
    for (const FitParameter& p : c.parameters) text += fmt::format("      {}\n", describe(p));
  }
  if (!fit.table_s.empty())
    text += "* table: none of these laws fits, so that quantiles stand for it\n";
  if (fit.lasts_longer()) {
    text += fmt::format(
        "  delays {} packets apart are correlated by {:.3f}, not {:.3f}: longer than "
        "jitter.correlation\n  can say; use the log as a trace where that matters\n",
        DelayFit::kFar, fit.far, fit.far_expected);
  }
  return text;
}

std::string commented(const std::string& lines) {
  std::string text = "# ";
  for (char c : lines) {
    text += c;
    if (c == '\n') text += "# ";
  }
  text.resize(text.size() - 2);
  return text;
}

/// "the loss changes over this log (2.1, 4.0, 6.3, 8.9 % in its quarters; p = 1e-05)".
std::string change_in_words(const Stationarity& s, const char* changes) {
  const Stationarity::Test& test = s.strongest();
  std::string detail;
  if (test.period_packets > 0.0) {
    detail = fmt::format("with a period of {:.4g} packets; ", test.period_packets);
  } else if (test.what == "the loss") {
    std::vector<std::string> shares;
    for (const double loss : s.loss) shares.push_back(fmt::format("{:.1f}", 100.0 * loss));
    detail = fmt::format("{} % in its quarters; ", fmt::join(shares, ", "));
  }
  return fmt::format("{} {} over this log ({}p = {:.2g})", test.what, changes, detail, s.p_value());
}

}  // namespace

std::string fit_verdict(const ChannelFit& fit) {
  if (!fit.enough) {
    return fmt::format(
        "too few losses or receptions to tell models apart ({} of {} lost; {} of each "
        "are needed)",
        fit.lost, fit.packets, kFewestEvents);
  }
  const char* const name = fit.choice == ChannelFit::Choice::independent ? "independent losses"
                           : fit.choice == ChannelFit::Choice::markov
                               ? "a two-state Markov process in time"
                               : "Gilbert-Elliott";
  if (!fit.stationarity.holds()) {
    return fmt::format(
        "{}, which no model here does; use the log as a trace instead, or fit parts of it",
        change_in_words(fit.stationarity, "changes"));
  }
  if (fit.goodness.fits() && !fit.stationarity.beyond_doubt()) {
    const bool sure = fit.stationarity.p_value() < Stationarity::kFalseAlarm;
    return fmt::format("{}, but {}", name,
                       change_in_words(fit.stationarity, sure ? "changes" : "may change"));
  }
  if (fit.goodness.fits()) return fmt::format("{}: nothing in this log speaks against it", name);
  std::vector<std::string> reasons;
  for (const GoodnessOfFit::Part& part : fit.goodness.parts) {
    if (part.p_value <
        GoodnessOfFit::kFalseAlarm / static_cast<double>(fit.goodness.parts.size())) {
      reasons.push_back(part.feature);
    }
  }
  return fmt::format(
      "this is not Gilbert-Elliott: the best of its kind ({}) does not have this log's {}; use the "
      "log as a trace instead",
      name, fmt::join(reasons, ", "));
}

std::string describe_fit(const ChannelFit& fit) {
  std::string text =
      fmt::format("{} packets, {} lost (PRR {:.4f})", fit.packets, fit.lost,
                  1.0 - static_cast<double>(fit.lost) / static_cast<double>(fit.packets));
  if (fit.interval_s > 0.0) {
    text +=
        fmt::format(", {} every {:.4g} ms", fit.periodic ? "sent" : "sent irregularly, on average",
                    fit.interval_s * 1e3);
  }
  if (!std::isnan(fit.delays.mean_s)) {
    text += fmt::format(", mean delay {:.4g} ms", fit.delays.mean_s * 1e3);
  }
  text += "\n\n";
  for (std::size_t i = 0; i < fit.candidates.size(); ++i) {
    const bool is_chosen = fit.choice != ChannelFit::Choice::markov && i == fit.best;
    text += describe_model(fit.candidates[i], fit, is_chosen);
  }
  if (fit.markov) {
    text += describe_model(*fit.markov, fit, fit.choice == ChannelFit::Choice::markov);
  }
  if (!fit.goodness.parts.empty()) {
    text += fmt::format("\nGoodness of fit, by {} simulated logs:\n", fit.goodness.simulations);
    for (const GoodnessOfFit::Part& p : fit.goodness.parts) {
      text += fmt::format("  {:31} {:8.1f}, {:.1f} expected, p = {:.3g}\n", p.feature, p.statistic,
                          p.expected, p.p_value);
    }
  }
  if (fit.enough) {
    for (const Stationarity::Test& test : fit.stationarity.tests) {
      const std::string period =
          test.period_packets > 0.0 ? fmt::format(" period of {:.4g} packets,", test.period_packets)
                                    : " same all the time,";
      text += fmt::format("  {}:{} p = {:.3g}\n", test.what, period, test.p_value);
    }
  }
  text += describe_delays(fit);
  return text + fmt::format("\nVerdict: {}\n", fit_verdict(fit));
}

std::string fit_to_toml(const ChannelFit& fit, const std::string& link, const std::string& source) {
  std::string text = fmt::format("# Fitted to {}: {} packets, {} lost.\n# {}.\n[channel.{}]\n",
                                 source, fit.packets, fit.lost, fit_verdict(fit), link);
  const ModelFit& model = chosen(fit);
  if (fit.choice == ChannelFit::Choice::markov) return text + markov_lines(*fit.markov);
  const GilbertElliott& g = fit.candidates[fit.best].model;
  if (fit.choice == ChannelFit::Choice::independent) {
    return text + "model = \"fixed\"\n" + line("prr", 1.0 - g.one_minus_k, &model.parameters[0]) +
           delay_lines(fit.delays);
  }
  const auto& p = model.parameters;
  text += "model = \"gilbert_elliott\"\n" + line("gilbert_elliott.p", g.p, &p[0]) +
          line("gilbert_elliott.r", g.r, &p[1]) +
          line("gilbert_elliott.one_minus_h", g.one_minus_h, &p[2]) +
          line("gilbert_elliott.one_minus_k", g.one_minus_k, &p[3]) + delay_lines(fit.delays);
  if (!fit.markov) return text;
  const char* const relation = fit.periodic
                                   ? "The same in time, which holds for other message rates, too"
                                   : "In time, less likely for this log";
  return text + fmt::format("#\n# {}:\n", relation) + commented(markov_lines(*fit.markov));
}

}  // namespace tether
