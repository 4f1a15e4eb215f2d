#include <boost/asio/buffer.hpp>
#include <boost/asio/compose.hpp>
#include <boost/asio/dispatch.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/websocket.hpp>
#include <boost/beast/websocket/teardown.hpp>
#include <chrono>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "tools/view/server/connections.hpp"
#include "tools/view/server/server_message.hpp"

namespace tether {
namespace {

/// A TCP connection under a WebSocket that gathers what is written: a write only copies, and many
/// messages go to the system with one call. Without this, each message costs such a call, and 20
/// clients with thousands of messages a second a whole core.
///
/// Being a copy, no write waits; the writer must check backlog_bytes() first. What the
/// WebSocket itself answers (pongs) is bounded: beyond kMostBytes writing fails.
class GatheringStream {
 public:
  using Socket = boost::asio::ip::tcp::socket;
  using executor_type = Socket::executor_type;  // NOLINT(readability-identifier-naming): Asio's
  using next_layer_type = Socket;               // NOLINT(readability-identifier-naming): Beast's
  using Error = boost::system::error_code;

  static constexpr std::size_t kMostBytes = std::size_t{8} << 20;

  explicit GatheringStream(Socket socket) : state_(std::make_shared<State>(std::move(socket))) {}

  executor_type get_executor() { return state_->socket.get_executor(); }
  Socket& next_layer() { return state_->socket; }
  const Socket& next_layer() const { return state_->socket; }

  /// Written, but not yet taken by the system.
  std::size_t backlog_bytes() const { return state_->pending.size() + state_->in_flight.size(); }
  /// Called each time when all has been taken.
  void on_flushed(std::function<void()> f) { state_->on_flushed = std::move(f); }
  /// Hands over what was written.
  void flush() { state_->flush(); }

  // Interface that Beast requires of a stream.
  template <class Buffers>
  std::size_t read_some(const Buffers& buffers, Error& error) {
    return state_->socket.read_some(buffers, error);
  }
  template <class Buffers>
  std::size_t read_some(const Buffers& buffers) {
    return state_->socket.read_some(buffers);
  }
  template <class Buffers, class Handler>
  auto async_read_some(const Buffers& buffers, Handler&& handler) {
    return state_->socket.async_read_some(buffers, std::forward<Handler>(handler));
  }
  template <class Buffers>
  std::size_t write_some(const Buffers& buffers, Error& error) {
    return state_->append(buffers, error);
  }
  template <class Buffers>
  std::size_t write_some(const Buffers& buffers) {
    Error error;
    const std::size_t size = state_->append(buffers, error);
    if (error) throw boost::system::system_error(error);
    return size;
  }
  template <class Buffers, class Handler>
  auto async_write_some(const Buffers& buffers, Handler&& handler) {
    Error error;
    const std::size_t size = state_->append(buffers, error);
    state_->flush();
    return boost::asio::async_compose<Handler, void(Error, std::size_t)>(
        [error, size, posted = false](auto& self) mutable {
          if (posted) return self.complete(error, size);
          posted = true;
          boost::asio::post(std::move(self));  // never from within the call
        },
        handler, state_->socket);
  }

 private:
  struct State : std::enable_shared_from_this<State> {
    explicit State(Socket s) : socket(std::move(s)) {}

    template <class Buffers>
    std::size_t append(const Buffers& buffers, Error& error) {
      const std::size_t size = boost::asio::buffer_size(buffers);
      error = {};
      if (failed || pending.size() + size > kMostBytes) {
        error = boost::asio::error::no_buffer_space;
        return 0;
      }
      const std::size_t begin = pending.size();
      pending.resize(begin + size);
      boost::asio::buffer_copy(boost::asio::buffer(pending.data() + begin, size), buffers);
      return size;
    }

    void flush() {
      if (!in_flight.empty() || pending.empty() || failed) return;
      std::swap(pending, in_flight);
      boost::asio::async_write(socket, boost::asio::buffer(in_flight),
                               [self = shared_from_this()](const Error& error, std::size_t) {
                                 self->in_flight.clear();
                                 self->failed = self->failed || error;
                                 if (self->failed) return;
                                 self->flush();
                                 if (self->on_flushed) self->on_flushed();
                               });
    }

    Socket socket;
    std::vector<char> pending, in_flight;
    bool failed = false;
    std::function<void()> on_flushed;
  };

  std::shared_ptr<State> state_;
};

// How a WebSocket ends the connection beneath it: found by Beast by their names.
inline void teardown(boost::beast::role_type role, GatheringStream& stream,
                     boost::system::error_code& error) {
  boost::beast::websocket::teardown(role, stream.next_layer(), error);
}
template <class Handler>
void async_teardown(boost::beast::role_type role, GatheringStream& stream, Handler&& handler) {
  boost::beast::websocket::async_teardown(role, stream.next_layer(),
                                          std::forward<Handler>(handler));
}

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
