#include "tools/experiment/sweep/figure_choice.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "common/base/csv_table.hpp"
#include "common/base/errors.hpp"
#include "tools/base/json.hpp"
#include "tools/experiment/sweep/grid.hpp"
#include "tools/runs/metric.hpp"

namespace tether {
namespace {

using Kind = FigureChoice::Kind;
using TableKind = TableChoice::Kind;
using nlohmann::json;

using namespace std::string_view_literals;

constexpr std::size_t kMostSeries = 7, kMostCompared = 14;

const std::vector<std::pair<std::string, Kind>> kFigureKinds{{"curve", Kind::curve},
                                                             {"heatmap", Kind::heatmap},
                                                             {"trajectories", Kind::trajectories},
                                                             {"risk_map", Kind::risk_map},
                                                             {"comparison", Kind::comparison},
                                                             {"pareto", Kind::pareto}};
const std::vector<std::pair<std::string, TableKind>> kTableKinds{
    {"means", TableKind::means}, {"ratio", TableKind::ratio}, {"limit", TableKind::limit}};

template <class Kinds>
auto kind_of(const Section& section, const Kinds& kinds) {
  const std::string kind = section.text("kind", kinds.front().first);
  std::string names;
  for (const auto& [name, value] : kinds) {
    if (name == kind) return value;
    names += fmt::format("{}\"{}\"", names.empty() ? "" : ", ", name);
  }
  section.refuse("kind", "one of " + names);
}

bool is_number(const std::string& text) { return !std::isnan(finite_number(text)); }

void check_key(const Section& section, const char* what, const std::string& key, bool needed,
               const std::vector<std::string>& keys) {
  const bool is_varied = std::find(keys.begin(), keys.end(), key) != keys.end();
  if (key.empty() ? needed : !is_varied) {
    section.refuse(what, fmt::format("a key that the grid varies: {}", fmt::join(keys, ", ")));
  }
}

/// where = { KEY = VALUE, KEY = [VALUE, VALUE] }
Selection read_where(const Section& section, const std::string& name,
                     const std::vector<std::string>& keys) {
  Selection selection;
  const toml::table* table = section.table("where");
  if (table == nullptr) return selection;
  for (const PlacedNode& given : flatten(*table, name)) {
    check_key(section, "where", given.key, true, keys);
    std::vector<std::string> values;
    const auto add = [&](const toml::node& node) {
      values.push_back(KeyValue{given.key, value_text(node)}.plain());
    };
    if (const auto* list = given.node->as_array()) {
      for (const toml::node& value : *list) add(value);
    } else {
      add(*given.node);
    }
    selection.emplace_back(given.key, std::move(values));
  }
  return selection;
}

TableChoice read_table(const toml::table& table, const std::string& name,
                       const std::vector<std::string>& keys) {
  const Section section(
      table, "table.", name,
      {"kind", "title", "metric", "columns", "key", "over", "under", "limit", "where"});
  TableChoice choice;
  choice.kind = kind_of(section, kTableKinds);
  choice.title = section.text("title", "");
  choice.metric = section.metric_expression("metric");
  choice.where = read_where(section, name, keys);
  if (choice.kind == TableKind::means) {
    const toml::node* columns = section.get("columns");
    const auto* list = columns == nullptr ? nullptr : columns->as_array();
    if (list == nullptr) section.refuse("columns", "a list of keys");
    for (const toml::node& column : *list) {
      choice.columns.push_back(column.value<std::string>().value_or(""));
      check_key(section, "columns", choice.columns.back(), true, keys);
    }
    return choice;
  }
  choice.key = section.text("key", "");
  check_key(section, "key", choice.key, true, keys);
  choice.limit = section.number("limit", 1e-12, 1e12, 0.0);
  if (choice.limit == 0.0) section.refuse("limit", "given, above 0");
  if (choice.kind == TableKind::ratio) {
    choice.over = section.text("over", "");
    choice.under = section.text("under", "");
    if (choice.over.empty() || choice.under.empty() || choice.over == choice.under) {
      section.refuse("over", "given, and under: two values of " + choice.key);
    }
  }
  return choice;
}

/// The value that a key has in an arm.
std::string value_in(const std::vector<KeyValue>& settings, const std::string& key) {
  for (const KeyValue& setting : settings) {
    if (setting.key == key) return setting.plain();
  }
  return "";
}

/// All that the grid sets in it.
std::string arm_text(const Arm& arm) {
  std::string text;
  for (const KeyValue& setting : arm.settings) text += setting.plain() + "\n";
  return text;
}

/// Two arms at one place of the figure: names a key that tells them apart.
std::string key_that_differs(const Arm& a, const Arm& b) {
  for (std::size_t i = 0; i < a.settings.size(); ++i) {
    if (a.settings[i].value != b.settings[i].value) return a.settings[i].key;
  }
  return "";
}

void check_figure(const FigureChoice& figure, const Experiment& experiment,
                  const std::string& file) {
  const auto refuse = [&file](const std::string& why) {
    throw UsageError(fmt::format("{}: [figure]: {}", file, why));
  };
  if (figure.kind == Kind::trajectories || figure.kind == Kind::risk_map) {
    if (experiment.trajectory_period_s > 0.0) return;
    refuse("trajectories and risk maps need trajectory_period_s");
  }
  std::map<std::pair<std::string, std::string>, const Arm*> places;
  std::set<std::string> series;
  for (const Arm& arm : experiment.arms) {
    if (!is_selected(figure.where, arm.settings)) continue;
    const std::string x = value_in(arm.settings, figure.x), y = value_in(arm.settings, figure.y);
    const bool is_pareto = figure.kind == Kind::pareto;
    const auto [other, is_new] =
        places.emplace(is_pareto ? std::pair(arm_text(arm), y) : std::pair(x, y), &arm);
    series.insert(y);
    if (is_pareto) continue;
    if (!is_new) {
      static constexpr char kMixed[] =
          "{0} varies too, but is neither x nor y: its values would be mixed; a curve for each: "
          "y = \"{0}\"";
      refuse(fmt::format(kMixed, key_that_differs(*other->second, arm)));
    }
    if (figure.kind != Kind::curve && !is_number(x)) {
      refuse(fmt::format("{} = {} is no number, as an axis needs", figure.x, x));
    }
    if (figure.kind == Kind::heatmap && !is_number(y)) {
      refuse(fmt::format("{} = {} is no number, as an axis needs", figure.y, y));
    }
  }
  if (places.empty()) refuse("where selects no combination");
  const bool is_comparison = figure.kind == Kind::comparison;
  const std::size_t most = is_comparison ? kMostCompared : kMostSeries;
  if (figure.kind != Kind::heatmap && series.size() > most) {
    refuse(fmt::format("a {} has at most {} series, and {} has {} values",
                       is_comparison ? "comparison" : "figure of this kind", most, figure.y,
                       series.size()));
  }
  if (!figure.floor.empty() && !series.contains(figure.floor)) {
    refuse(fmt::format("floor = \"{}\" must be a value of {}", figure.floor, figure.y));
  }
}

void check_table(const TableChoice& table, const Experiment& experiment, const std::string& file) {
  const auto refuse = [&](const std::string& why) {
    throw UsageError(fmt::format("{}: [[table]] \"{}\": {}", file, table.title, why));
  };
  std::set<std::string> values;
  bool any = false;
  for (const Arm& arm : experiment.arms) {
    if (!is_selected(table.where, arm.settings)) continue;
    any = true;
    if (table.key.empty()) continue;
    values.insert(value_in(arm.settings, table.key));
  }
  if (!any) refuse("where selects no combination");
  if (table.kind == TableKind::ratio) {
    for (const std::string& value : {table.over, table.under}) {
      if (!values.contains(value)) refuse(fmt::format("{} is never \"{}\"", table.key, value));
    }
  }
  if (table.kind != TableKind::limit) return;
  for (const std::string& value : values) {
    if (!is_number(value)) refuse(fmt::format("{} = {} is no number", table.key, value));
  }
}

}  // namespace

std::optional<FigureChoice> read_figure(const Section& file, const std::string& name,
                                        const std::vector<std::string>& keys) {
  const toml::table* table = file.table("figure");
  if (table == nullptr) return std::nullopt;
  const Section section(*table, "figure.", name,
                        {"kind", "x", "y", "metric", "title", "where", "floor", "reversed",
                         "x_label", "y_label", "note"});
  FigureChoice figure;
  figure.kind = kind_of(section, kFigureKinds);
  const bool is_pareto = figure.kind == Kind::pareto;
  figure.x = is_pareto ? section.metric_expression("x") : section.text("x", "");
  figure.y = section.text("y", "");
  figure.metric = section.metric_expression("metric");
  figure.title = section.text("title", "");
  figure.where = read_where(section, name, keys);
  figure.floor = section.text("floor", "");
  figure.reversed = section.boolean("reversed", false);
  figure.x_label = section.text("x_label", "");
  figure.y_label = section.text("y_label", "");
  figure.note = section.text("note", "");
  const bool is_comparison = figure.kind == Kind::comparison;
  for (const char* key : {"floor", "reversed", "x_label", "note"}) {
    const bool is_known = is_comparison || (figure.kind == Kind::curve && key == "x_label"sv);
    if (!is_known && section.get(key) != nullptr) {
      section.refuse(key, "left out: only comparisons have it");
    }
  }
  const bool has_axes = figure.kind != Kind::trajectories && figure.kind != Kind::risk_map;
  if (is_pareto && (section.get("x") == nullptr || figure.x == figure.metric)) {
    section.refuse("x", "given, a metric other than that of y, which is `metric`");
  }
  if (!is_pareto) check_key(section, "x", figure.x, has_axes, keys);
  check_key(section, "y", figure.y, figure.kind == Kind::heatmap || is_comparison || is_pareto,
            keys);
  return figure;
}

std::vector<TableChoice> read_tables(const Section& file, const std::string& name,
                                     const std::vector<std::string>& keys) {
  std::vector<TableChoice> tables;
  const toml::node* given = file.get("table");
  if (given == nullptr) return tables;
  const auto* list = given->as_array();
  if (list == nullptr || !list->is_homogeneous<toml::table>()) {
    file.refuse("table", "[[table]], once for each");
  }
  for (const toml::node& table : *list) tables.push_back(read_table(*table.as_table(), name, keys));
  return tables;
}

void check_choices(const Experiment& experiment, const std::string& file) {
  if (experiment.figure) check_figure(*experiment.figure, experiment, file);
  for (const TableChoice& table : experiment.tables) check_table(table, experiment, file);
}

std::string to_text(const std::optional<FigureChoice>& figure) {
  if (!figure) return "none";
  json all{{"kind", static_cast<int>(figure->kind)},
           {"x", figure->x},
           {"y", figure->y},
           {"metric", figure->metric},
           {"title", figure->title},
           {"where", figure->where},
           {"floor", figure->floor},
           {"reversed", figure->reversed},
           {"x_label", figure->x_label},
           {"note", figure->note}};
  if (!figure->y_label.empty()) all["y_label"] = figure->y_label;  // sweeps without go on
  return json_text(all);
}

std::optional<FigureChoice> figure_of(const std::string& text) {
  if (text == "none") return std::nullopt;
  const json j = parse_json(text);
  const int kind = j.at("kind").get<int>();
  FigureChoice figure;
  figure.metric = j.at("metric").get<std::string>();
  if (kind < 0 || kind > static_cast<int>(Kind::pareto)) throw UsageError("an unknown figure");
  const MetricExpression checked(figure.metric);  // throws if this version does not know it
  figure.kind = static_cast<Kind>(kind);
  figure.x = j.at("x").get<std::string>();
  figure.y = j.at("y").get<std::string>();
  figure.title = j.at("title").get<std::string>();
  figure.where = j.value("where", Selection{});  // sweeps of older versions have none
  figure.floor = j.value("floor", "");
  figure.reversed = j.value("reversed", false);
  figure.x_label = j.value("x_label", "");
  figure.y_label = j.value("y_label", "");
  figure.note = j.value("note", "");
  return figure;
}

std::string to_text(const std::vector<TableChoice>& tables) {
  json all = json::array();
  for (const TableChoice& table : tables) {
    all.push_back({{"kind", static_cast<int>(table.kind)},
                   {"title", table.title},
                   {"metric", table.metric},
                   {"columns", table.columns},
                   {"key", table.key},
                   {"over", table.over},
                   {"under", table.under},
                   {"limit", table.limit},
                   {"where", table.where}});
  }
  return json_text(all);
}

std::vector<TableChoice> tables_of(const std::string& text) {
  std::vector<TableChoice> tables;
  for (const json& j : parse_json(text)) {
    const int kind = j.at("kind").get<int>();
    TableChoice table;
    table.metric = j.at("metric").get<std::string>();
    if (kind < 0 || kind > static_cast<int>(TableKind::limit)) {
      throw UsageError("an unknown table");
    }
    const MetricExpression checked(table.metric);
    table.kind = static_cast<TableKind>(kind);
    table.title = j.at("title").get<std::string>();
    table.columns = j.at("columns").get<std::vector<std::string>>();
    table.key = j.at("key").get<std::string>();
    table.over = j.at("over").get<std::string>();
    table.under = j.at("under").get<std::string>();
    table.limit = j.at("limit").get<double>();
    table.where = j.at("where").get<Selection>();
    tables.push_back(std::move(table));
  }
  return tables;
}

}  // namespace tether
