#include <boost/asio/dispatch.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>

#include "tools/view/protocol/server_message.hpp"
#include "tools/view/web/connections.hpp"
#include "tools/view/web/gathering_stream.hpp"

namespace tether {
namespace {

namespace beast = boost::beast;
namespace websocket = beast::websocket;
using Error = boost::system::error_code;

/// The longest message that a client may send.
constexpr std::size_t kMostMessageBytes = std::size_t{64} << 10;
/// Maximum number of bytes handed to the system ahead.
constexpr std::size_t kMostBacklogBytes = std::size_t{256} << 10;
/// A client that has been silent for this long, pongs included, is gone.
constexpr auto kPingPatience = std::chrono::seconds{30};

/// One client's WebSocket: carries messages between it and the hub. Lives as long as it is read.
class WebsocketConnection : public std::enable_shared_from_this<WebsocketConnection> {
 public:
  WebsocketConnection(boost::asio::ip::tcp::socket socket, ViewServices& services,
                      std::shared_ptr<CountedConnection> counted)
      : services_(services),
        counted_(std::move(counted)),
        socket_(GatheringStream(std::move(socket))),
        received_(kMostMessageBytes) {}

  ~WebsocketConnection() {
    if (client_ == 0) return;
    services_.pumps.erase(client_);
    services_.hub.disconnect(client_);
  }
  WebsocketConnection(const WebsocketConnection&) = delete;
  WebsocketConnection& operator=(const WebsocketConnection&) = delete;

  void start(const UpgradeRequest& request) {
    websocket::stream_base::timeout timeout{};
    timeout.handshake_timeout = std::chrono::seconds{10};
    timeout.idle_timeout = kPingPatience;
    timeout.keep_alive_pings = true;
    socket_.set_option(timeout);
    socket_.set_option(websocket::stream_base::decorator(
        [protocol = chosen_protocol(request)](websocket::response_type& response) {
          response.set(beast::http::field::sec_websocket_protocol, protocol);
        }));
    socket_.read_message_max(kMostMessageBytes);
    socket_.auto_fragment(false);
    socket_.async_accept(request, [self = shared_from_this()](const Error& error) {
      if (!error) self->connected();
    });
  }

 private:
  void connected() {
    client_ = services_.hub.connect();
    const std::weak_ptr<WebsocketConnection> weak = weak_from_this();
    const auto pump = [weak] {
      if (const auto self = weak.lock()) self->pump();
    };
    services_.pumps[client_] = pump;
    socket_.next_layer().on_flushed(pump);
    pump();
    read();
  }

  void read() {
    socket_.async_read(received_, [self = shared_from_this()](const Error& error, std::size_t) {
      if (!error) self->on_message();
    });
  }

  void on_message() {
    const auto data = received_.cdata();
    const auto* const bytes = static_cast<const std::uint8_t*>(data.data());
    if (socket_.got_text()) {
      services_.hub.on_text(client_, {reinterpret_cast<const char*>(bytes), data.size()});
    } else {
      services_.hub.on_binary(client_, {bytes, data.size()});
    }
    received_.consume(received_.size());
    pump();
    read();
  }

  void pump() {
    Session& session = services_.hub.session(client_);
    GatheringStream& stream = socket_.next_layer();
    if (session.is_overwhelmed()) {
      Error ignored;
      stream.next_layer().close(ignored);  // ends the reading, and so this
      return;
    }
    while (socket_.is_open() && stream.backlog_bytes() < kMostBacklogBytes) {
      const auto message = session.next();
      if (!message) break;
      send(*message);
    }
    stream.flush();
  }

  void send(const Outgoing& message) {
    const std::string empty;
    const std::string& payload = message.payload ? *message.payload : empty;
    const std::array<boost::asio::const_buffer, 2> parts{boost::asio::buffer(message.header),
                                                         boost::asio::buffer(payload)};
    Error error;  // the reading notices it, too
    socket_.text(message.is_text);
    socket_.write(parts, error);
  }

  ViewServices& services_;
  std::shared_ptr<CountedConnection> counted_;
  websocket::stream<GatheringStream> socket_;
  beast::flat_buffer received_;
  ClientId client_ = 0;
};

}  // namespace

std::string chosen_protocol(const UpgradeRequest& request) {
  const beast::http::token_list offered(request[beast::http::field::sec_websocket_protocol]);
  for (const auto& protocol : offered) {
    if (protocol == kFoxgloveProtocol || protocol == kFoxgloveSdkProtocol) {
      return {protocol.data(), protocol.size()};
    }
  }
  return "";
}

void serve_websocket(boost::asio::ip::tcp::socket socket, const UpgradeRequest& request,
                     ViewServices& services, std::shared_ptr<CountedConnection> counted) {
  Error ignored;
  socket.set_option(boost::asio::ip::tcp::no_delay(true), ignored);
  std::make_shared<WebsocketConnection>(std::move(socket), services, std::move(counted))
      ->start(request);
}

}  // namespace tether
