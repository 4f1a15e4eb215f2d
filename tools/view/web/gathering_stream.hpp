#pragma once

#include <boost/asio/buffer.hpp>
#include <boost/asio/compose.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/websocket/teardown.hpp>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

namespace tether {

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

}  // namespace tether
