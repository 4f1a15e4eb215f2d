#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "tools/view/server/hub.hpp"
#include "tools/view/server/web_site.hpp"

namespace tether {

/// The HTTP and WebSocket server of `tether view`: in a thread of its own, so that no client, slow,
/// dead or hostile, delays the program that it shows. docs/reference/view-protocol.md says what it
/// serves.
///
/// Arguments are copied, and taken over by its thread within 10 ms; all of its functions may
/// be called from any thread, and none waits for a client.
class ViewServer {
 public:
  struct Options {
    std::string address = "127.0.0.1";  ///< to listen on; IPv4 or IPv6, in digits
    std::uint16_t port = 8765;          ///< 0: any that is free
    std::string token;                  ///< has to be given unless the address is loopback
    std::vector<std::string> origins;   ///< origins of external pages that have access
    std::filesystem::path page;         ///< folder of the page's files
    std::string title;                  ///< title of the shown source
    std::vector<std::string> publishable;
    bool has_time = false;  ///< tell_time() will be called
    std::string run_json;   ///< content of /api/run.json
    /// Site that is served instead, if it is set: no page, no /api and no WebSocket then.
    WebSite site = nullptr;
  };
  static constexpr std::size_t kMostClients = 100;

  /// Listens from here on. Throws UsageError for an invalid address; std::runtime_error if the
  /// port is taken, naming the next one that is free.
  explicit ViewServer(const Options& options, std::unique_ptr<DerivedChannels> derived = nullptr);
  /// Says good-bye to all clients and ends.
  ~ViewServer();
  ViewServer(const ViewServer&) = delete;
  ViewServer& operator=(const ViewServer&) = delete;

  /// "http://127.0.0.1:8765/", with the token if there is one: where this host reaches it.
  std::string address() const;
  /// It listens on all addresses of this host (0.0.0.0 or ::).
  bool is_everywhere() const;
  std::uint16_t port() const;

  // See Hub.
  void hear(std::string_view topic, std::span<const std::uint8_t> bytes, std::uint64_t time_ns);
  void publish(const DerivedChannels::Description& channel, std::uint64_t time_ns,
               std::string json);
  void update(std::vector<Parameter> parameters);
  void answer(ViewAnswer answer);
  void say(StatusLevel level, std::string text);
  void tell_time(std::uint64_t time_ns);

  /// Readable while clients' requests wait for take_requests(), of which the last 1000 do.
  int requests_fd() const;
  std::vector<ViewRequest> take_requests();

 private:
  class Core;
  std::unique_ptr<Core> core_;
};

}  // namespace tether
