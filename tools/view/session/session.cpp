#include "tools/view/session/session.hpp"

#include <utility>

namespace tether {

void Session::push_text(SharedText text) {
  text_bytes_ += text->size();
  texts_.push_back({pushed_++, {true, {}, std::move(text)}});
}

void Session::push_data(Outgoing message) {
  data_bytes_ += message.size_bytes();
  data_.push_back({pushed_++, std::move(message)});
  while (data_bytes_ > limits_.data_bytes) {
    pop(data_, data_bytes_);
    ++dropped_;
  }
}

Outgoing Session::pop(std::deque<Waiting>& queue, std::size_t& bytes) {
  Outgoing message = std::move(queue.front().message);
  queue.pop_front();
  bytes -= message.size_bytes();
  return message;
}

std::optional<Outgoing> Session::next() {
  if (idle()) return std::nullopt;
  const bool text_first =
      data_.empty() || (!texts_.empty() && texts_.front().place < data_.front().place);
  return text_first ? pop(texts_, text_bytes_) : pop(data_, data_bytes_);
}

}  // namespace tether
