#include "doors/link/node/config.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <utility>

#include "common/base/errors.hpp"
#include "common/base/input_file.hpp"
#include "common/base/pattern.hpp"
#include "common/base/text.hpp"
#include "common/base/toml_reader.hpp"
#include "common/lcm/lcm_url.hpp"
#include "doors/link/key_file.hpp"

namespace tether::link {
namespace {

constexpr char kAddressForm[] = "an IPv4 address and a port, such as \"192.0.2.7:7700\"";

/// The tables of a list [[name]].
std::vector<TomlReader> list(const TomlReader& top, const std::string& name,
                             const std::vector<std::string>& keys) {
  std::vector<TomlReader> all;
  const toml::node* const node = top.find(name);
  if (node == nullptr) return all;
  const auto* const array = node->as_array();
  for (std::size_t i = 0; array != nullptr && i < array->size(); ++i) {
    const toml::node& entry = *array->get(i);
    if (entry.is_table()) {
      all.emplace_back(*entry.as_table(), top.file(), name, keys);
    }
  }
  if (array == nullptr || all.size() != array->size()) {
    top.refuse_at(node->source().begin.line,
                  fmt::format("{0} is a list: write [[{0}]], with two brackets", name));
  }
  return all;
}

std::string required_text(const TomlReader& reader, const std::string& key,
                          const std::string& meaning) {
  std::string text;
  reader.require(key, "a text in quotes (" + meaning + ")");
  reader.text(key, text, meaning);
  return text;
}

/// Result of `make` for a key's value; its UsageError gets file and line.
template <class Make>
auto made(const TomlReader& reader, const std::string& key, const Make& make) {
  try {
    return make();
  } catch (const UsageError& error) {
    const toml::node* const node = reader.find(key);
    reader.refuse_at(node == nullptr ? reader.line() : node->source().begin.line,
                     fmt::format("{}: {}", key, error.what()));
  }
}

/// Names of paths and peers are parts of lines, and of file names.
std::string required_name(const TomlReader& reader, const std::string& what) {
  static const Pattern kName("[A-Za-z0-9][A-Za-z0-9_.-]{0,62}");
  std::string name = required_text(reader, "name", what);
  if (!kName.matches(name)) {
    reader.refuse("name", *reader.find("name"),
                  "1 to 63 letters, digits, _, . and -, the first a letter or digit");
  }
  return name;
}

std::vector<std::string> texts(const TomlReader& reader, const std::string& key,
                               const std::string& meaning) {
  const toml::node* const node = reader.find(key);
  if (node == nullptr) return {};
  const std::string allowed = fmt::format("a list of texts in quotes ({})", meaning);
  const auto* const array = node->as_array();
  if (array == nullptr) reader.refuse(key, *node, allowed);
  std::vector<std::string> all;
  for (const toml::node& entry : *array) {
    if (!entry.is_string()) reader.refuse(key, *node, allowed);
    all.push_back(entry.as_string()->get());
  }
  return all;
}

PathConfig read_path(const TomlReader& reader) {
  PathConfig path;
  path.name = required_name(reader, "for reports");
  const std::string bind = required_text(reader, "bind", "our address and port");
  path.bind = made(reader, "bind", [&] { return address_from_text(bind); });
  reader.text("interface", path.interface, "a network interface");
  return path;
}

PeerConfig read_peer(const TomlReader& reader, std::size_t paths) {
  PeerConfig peer;
  peer.name = required_name(reader, "for reports and messages");
  const std::string key = required_text(reader, "public_key", "64 hexadecimal digits");
  const std::optional<Key> value = key_from_text(key);
  if (!value) {
    reader.refuse("public_key", *reader.find("public_key"),
                  "64 hexadecimal digits: `tether-link show FILE` on the other host prints them");
  }
  peer.setup.key = *value;
  const auto addresses = texts(reader, "addresses", "one for each path, \"\": learned");
  if (addresses.size() > paths) {
    reader.refuse("addresses", *reader.find("addresses"),
                  fmt::format("no more than there are paths, {}", paths));
  }
  for (const std::string& text : addresses) {
    if (text.empty()) {
      peer.setup.addresses.emplace_back();
    } else {
      peer.setup.addresses.push_back(
          made(reader, "addresses", [&] { return std::optional{address_from_text(text)}; }));
    }
  }
  const auto channels = [&](const std::string& name) {
    const auto patterns = texts(reader, name, "patterns of channels");
    const bool has_arrow = std::any_of(patterns.begin(), patterns.end(), split_at_arrow);
    if (has_arrow) {
      reader.refuse(name, *reader.find(name), "names as the peer sends them: only `send` renames");
    }
    return made(reader, name, [&] { return ChannelList(patterns); });
  };
  const auto send = texts(reader, "send", "patterns of channels");
  const bool own = std::any_of(send.begin(), send.end(), [](const std::string& rule) {
    return rule.find("LINK/") != std::string::npos;
  });
  if (own) reader.refuse("send", *reader.find("send"), "other channels: LINK/… stays on its host");
  peer.setup.rules.send = made(reader, "send", [&] { return SendRules(send); });
  peer.setup.rules.receive = channels("receive");
  peer.setup.rules.latest_only = channels("latest_only");
  peer.setup.rules.timed =
      reader.has("timed") ? channels("timed") : ChannelList({".*/(PLAN|PRELOAD)"});
  return peer;
}

template <class List>
void check_names(const TomlReader& top, const List& list, const std::string& what) {
  for (std::size_t i = 0; i < list.size(); ++i) {
    for (std::size_t k = 0; k < i; ++k) {
      if (list[i].name != list[k].name) continue;
      top.refuse_at(1, fmt::format("two {}s are called \"{}\"", what,
                                   printable(list[i].name, kLongestNameShown)));
    }
  }
}

void read_settings(const TomlReader& top, LinkConfig& config) {
  std::size_t mtu = 1400;
  top.integer("mtu", mtu, 576, 65535, "bytes of an IP packet that all paths carry");
  config.settings.datagram_bytes = mtu - kIpAndUdpBytes;
  std::string second = "always";
  top.text("second_path", second, "\"always\" or \"deferred\"");
  if (second != "always" && second != "deferred") {
    top.refuse("second_path", *top.find("second_path"), "\"always\" or \"deferred\"");
  }
  double after_ms = 20.0, rekey_s = 3600.0, report_s = 1.0;
  top.number("second_after_ms", after_ms, 1.0, 1000.0, "until the second path gets its copy");
  if (second == "deferred") config.settings.second_after = from_seconds(after_ms * 1e-3);
  if (second == "always" && top.has("second_after_ms")) {
    top.refuse("second_after_ms", *top.find("second_after_ms"),
               "left out: it does nothing unless second_path = \"deferred\"");
  }
  top.number("rekey_s", rekey_s, 10.0, 86400.0, "until a session gets new keys");
  config.settings.rekey.after = from_seconds(rekey_s);
  top.number("report_period_s", report_s, 0.1, 60.0, "between two reports");
  config.report_period = from_seconds(report_s);
  double warning_ms = 50.0, limit_ms = 200.0;
  top.number("clock_warning_ms", warning_ms, 1.0, 60000.0, "between the clocks, to be warned of");
  top.number("clock_limit_ms", limit_ms, 1.0, 60000.0, "between the clocks, to refuse `timed`");
  config.clock_warning = from_seconds(warning_ms * 1e-3);
  config.settings.clock_limit = from_seconds(limit_ms * 1e-3);
}

}  // namespace

Address address_from_text(const std::string& text) {
  const auto colon = text.rfind(':');
  in_addr ip{};
  const auto port =
      colon == std::string::npos ? std::nullopt : to_number<std::uint16_t>(text.substr(colon + 1));
  if (!port || *port == 0 || inet_pton(AF_INET, text.substr(0, colon).c_str(), &ip) != 1) {
    throw UsageError(
        fmt::format("\"{}\" must be {}", printable(text, kLongestValueShown), kAddressForm));
  }
  return {ntohl(ip.s_addr), *port};
}

std::string to_text(const Address& a) {
  return fmt::format("{}.{}.{}.{}:{}", a.ip >> 24, a.ip >> 16 & 255, a.ip >> 8 & 255, a.ip & 255,
                     a.port);
}

std::vector<PeerSetup> LinkConfig::setups() const {
  std::vector<PeerSetup> all;
  for (const PeerConfig& peer : peers) all.push_back(peer.setup);
  return all;
}

LinkConfig parse_link_config(const std::string& text, const std::string& file) {
  const toml::table table = parse_toml(text, file);
  const TomlReader top(table, file, "",
                       {"key", "lcm_url", "mtu", "second_path", "second_after_ms", "rekey_s",
                        "report_period_s", "clock_warning_ms", "clock_limit_ms", "path", "peer"});
  LinkConfig config;
  config.file = file;
  const std::filesystem::path key = required_text(top, "key", "our key file");
  config.key_file = (std::filesystem::path(file).parent_path() / key).string();
  std::string url = kDefaultLcmUrl;
  top.text("lcm_url", url, "udpm://GROUP:PORT?ttl=0");
  config.lcm_url = made(top, "lcm_url", [&] { return checked_lcm_url(url); });
  // Beyond the host, LCM is what the link is there to avoid.
  if (multicast_group(config.lcm_url).empty() || lcm_option(config.lcm_url, "ttl") != 0) {
    top.refuse("lcm_url", *top.find("lcm_url"), "udpm://GROUP:PORT?ttl=0");
  }
  read_settings(top, config);
  for (const TomlReader& path : list(top, "path", {"name", "bind", "interface"})) {
    config.paths.push_back(read_path(path));
  }
  if (config.paths.empty() || config.paths.size() > kMostPaths) {
    top.refuse_at(1, fmt::format("{} tables [[path]]: one or two are needed", config.paths.size()));
  }
  config.settings.paths = config.paths.size();
  const std::vector<std::string> keys{"name",    "public_key",  "addresses", "send",
                                      "receive", "latest_only", "timed"};
  for (const TomlReader& peer : list(top, "peer", keys)) {
    config.peers.push_back(read_peer(peer, config.paths.size()));
  }
  if (config.peers.empty() || config.peers.size() > Endpoint::kMostPeers) {
    top.refuse_at(1, fmt::format("{} tables [[peer]]: 1 to {} are needed", config.peers.size(),
                                 Endpoint::kMostPeers));
  }
  check_names(top, config.paths, "path");
  if (config.paths.size() == 2 && config.paths[0].bind == config.paths[1].bind &&
      config.paths[0].interface == config.paths[1].interface) {
    top.refuse_at(1, "two paths bind to " + to_text(config.paths[0].bind) +
                         ": each needs a port, or an interface, of its own");
  }
  check_names(top, config.peers, "peer");
  return config;
}

LinkConfig load_link_config(const std::string& file) {
  const std::string text = read_input(file, "the link's configuration", kMostTomlBytes);
  check_only_owner_writes(file);
  return parse_link_config(text, file);
}

}  // namespace tether::link
