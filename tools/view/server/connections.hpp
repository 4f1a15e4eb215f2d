#pragma once

#include <boost/asio/ip/address.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/message.hpp>
#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <string>

#include "tools/view/server/access.hpp"
#include "tools/view/server/hub.hpp"
#include "tools/view/server/page_folder.hpp"
#include "tools/view/server/web_site.hpp"

namespace tether {

/// A connection that has sent no request that may pass: anybody's.
struct WaitingConnection {
  boost::asio::ip::address from;
  std::function<void()> close;
};

/// Connections that wait, oldest first. When there are too many of one address, or in all, the
/// oldest of that address, or of the one that has most, is closed: who opens connections and sends
/// nothing takes the place of its own.
class WaitingRoom {
 public:
  static constexpr std::size_t kMostOfOneAddress = 64;
  static constexpr std::size_t kMost = 256;

  /// Returns the one that has to be closed, if there is one; it has left.
  std::shared_ptr<WaitingConnection> enter(std::shared_ptr<WaitingConnection> connection);
  void leave(const std::shared_ptr<WaitingConnection>& connection);
  std::size_t size() const { return waiting_.size(); }

 private:
  std::list<std::shared_ptr<WaitingConnection>> waiting_;
};

/// Services that connections share; all of it belongs to the server's thread.
struct ViewServices {
  Hub& hub;
  AccessRules access;
  PageFolder page;
  std::string run_json;
  WebSite site;  ///< in place of all else, if there is one
  std::function<std::string()> status_json;
  std::size_t most_connections = 0;

  std::size_t connections = 0;  ///< clients that have access
  WaitingRoom waiting = {};
  std::int64_t refused = 0;
  /// Sends what waits for each client.
  std::map<ClientId, std::function<void()>> pumps = {};
};

/// Counts a connection as long as it lives.
class CountedConnection {
 public:
  explicit CountedConnection(ViewServices& services) : services_(services) {
    ++services.connections;
  }
  ~CountedConnection() { --services_.connections; }
  CountedConnection(const CountedConnection&) = delete;
  CountedConnection& operator=(const CountedConnection&) = delete;

 private:
  ViewServices& services_;
};

/// Answers one connection's requests until it ends or becomes a WebSocket.
void serve_http(boost::asio::ip::tcp::socket socket, ViewServices& services);

using UpgradeRequest = boost::beast::http::request<boost::beast::http::empty_body>;

/// The first of our protocols that a client offers; empty if none.
std::string chosen_protocol(const UpgradeRequest& request);

/// Goes on with a connection whose `request` to become a WebSocket may pass.
void serve_websocket(boost::asio::ip::tcp::socket socket, const UpgradeRequest& request,
                     ViewServices& services, std::shared_ptr<CountedConnection> counted);

}  // namespace tether
