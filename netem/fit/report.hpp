#pragma once

#include <string>

#include "netem/fit/models.hpp"

namespace tether {

/// In a sentence: the fitted model, or that no model fits, and the evidence.
std::string fit_verdict(const ChannelFit& fit);

/// For people: the log, every model with its parameters, standard errors, 95 % intervals, AIC and
/// BIC, and the goodness of fit. Ends with a newline.
std::string describe_fit(const ChannelFit& fit);

/// The chosen model as a table [channel.<link>] of a scenario file, what is known of its accuracy
/// as comments, and for a periodic sender the equivalent Markov process as a comment. `source`
/// names where the log came from. Loading the snippet gives the model with all digits of its
/// parameters.
std::string fit_to_toml(const ChannelFit& fit, const std::string& link, const std::string& source);

}  // namespace tether
