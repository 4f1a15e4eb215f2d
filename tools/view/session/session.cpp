#include "tools/view/session/session.hpp"

#include <algorithm>
#include <utility>

namespace tether {

void Session::push_text(SharedText text) {
  text_bytes_ += text->size();
  texts_.push_back({pushed_++, {true, {}, std::move(text), 0}});
}

void Session::push_data(Outgoing message) {
  data_bytes_ += message.size_bytes();
  ++waiting_[message.series];
  data_.push_back({pushed_++, std::move(message)});
  while (data_bytes_ > limits_.data_bytes) drop_one();
}

/// One message less.
void Session::forget(std::uint64_t series) {
  const auto found = waiting_.find(series);
  if (--found->second == 0) waiting_.erase(found);
}

/// The oldest that a newer one of its series replaces; the oldest of all if each is the only one.
void Session::drop_one() {
  auto found = std::find_if(data_.begin(), data_.end(), [this](const Waiting& one) {
    return waiting_.at(one.message.series) > 1;
  });
  if (found == data_.end()) found = data_.begin();
  data_bytes_ -= found->message.size_bytes();
  forget(found->message.series);
  data_.erase(found);
  ++dropped_;
}

std::optional<Outgoing> Session::next() {
  if (idle()) return std::nullopt;
  const bool text_first =
      data_.empty() || (!texts_.empty() && texts_.front().place < data_.front().place);
  std::deque<Waiting>& queue = text_first ? texts_ : data_;
  std::optional<Outgoing> message = std::move(queue.front().message);
  queue.pop_front();
  (text_first ? text_bytes_ : data_bytes_) -= message->size_bytes();
  if (!text_first) forget(message->series);
  return message;
}

}  // namespace tether
