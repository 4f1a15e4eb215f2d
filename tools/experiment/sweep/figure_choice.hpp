#pragma once

#include <optional>
#include <string>
#include <vector>

#include "tools/experiment/sweep/experiment.hpp"
#include "tools/experiment/sweep/section.hpp"

namespace tether {

// Figure that an experiment file chooses: [figure] and each [[table]]. `keys` are the grid's. All
// throw UsageError that names file, line, key and what is allowed.

std::optional<FigureChoice> read_figure(const Section& file, const std::string& name,
                                        const std::vector<std::string>& keys);
std::vector<TableChoice> read_tables(const Section& file, const std::string& name,
                                     const std::vector<std::string>& keys);

/// Refuses figures and tables that cannot be made from the runs, before they are made.
void check_choices(const Experiment& experiment, const std::string& file);

/// Conversion to text for a store, and back; "none": no figure.
std::string to_text(const std::optional<FigureChoice>& figure);
std::optional<FigureChoice> figure_of(const std::string& text);
std::string to_text(const std::vector<TableChoice>& tables);
std::vector<TableChoice> tables_of(const std::string& text);

}  // namespace tether
