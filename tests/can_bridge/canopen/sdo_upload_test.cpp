#include "can_bridge/bus/sdo_upload.hpp"

#include <gmock/gmock.h>

#include <string>
#include <vector>

namespace tether {
namespace {

using ::testing::IsEmpty;
using Outcome = SdoUpload::Result::Outcome;

Duration ms(int milliseconds) { return std::chrono::milliseconds(milliseconds); }
Instant at_ms(int milliseconds) { return kStart + ms(milliseconds); }

/// Reads 0x1008:0 of node 5.
struct Upload {
  SdoUpload upload{5, 0x1008, 0, ms(100), 1};

  std::vector<CanFrame> tick(int milliseconds) {
    std::vector<CanFrame> out;
    upload.tick(at_ms(milliseconds), out);
    return out;
  }
  void answer(std::initializer_list<std::uint8_t> bytes) {
    upload.on_frame(CanFrame::make(0x585, bytes));
  }
  Outcome outcome() const {
    EXPECT_TRUE(upload.result());
    return upload.result() ? upload.result()->outcome : Outcome::no_answer;
  }
};

const CanFrame kRequest = CanFrame::make(0x605, {0x40, 0x08, 0x10, 0, 0, 0, 0, 0});

TEST(SdoUpload, AsksOnceAndReadsAnExpeditedAnswerOfEachLength) {
  const std::vector<std::uint8_t> data{0x11, 0x22, 0x33, 0x44};
  for (std::size_t size = 1; size <= 4; ++size) {
    Upload u;
    EXPECT_EQ(u.tick(0), std::vector{kRequest});
    EXPECT_THAT(u.tick(99), IsEmpty());
    const auto command = static_cast<std::uint8_t>(0x43 | (4 - size) << 2);
    u.answer({command, 0x08, 0x10, 0, 0x11, 0x22, 0x33, 0x44});
    ASSERT_EQ(u.outcome(), Outcome::done);
    EXPECT_EQ(u.upload.result()->bytes,
              std::vector<std::uint8_t>(data.begin(), data.begin() + static_cast<int>(size)));
    EXPECT_TRUE(u.upload.result()->size_known);
    EXPECT_THAT(u.tick(1000), IsEmpty());
  }
}

TEST(SdoUpload, AnAnswerWithoutASizeIsFourBytesOfWhichSomeMayNotCount) {
  Upload u;
  u.tick(0);
  u.answer({0x42, 0x08, 0x10, 0, 1, 2, 3, 4});
  ASSERT_EQ(u.outcome(), Outcome::done);
  EXPECT_EQ(u.upload.result()->bytes.size(), 4U);
  EXPECT_FALSE(u.upload.result()->size_known);
}

TEST(SdoUpload, ReadsSegmentsWithAlternatingToggle) {
  Upload u;
  u.tick(0);
  u.answer({0x41, 0x08, 0x10, 0, 9, 0, 0, 0});
  EXPECT_EQ(u.tick(1), std::vector{CanFrame::make(0x605, {0x60, 0, 0, 0, 0, 0, 0, 0})});
  u.answer({0x00, 'T', 'i', 'n', 'y', ' ', 'D', 'r'});
  EXPECT_EQ(u.tick(2), std::vector{CanFrame::make(0x605, {0x70, 0, 0, 0, 0, 0, 0, 0})});
  u.answer({0x1B, 'v', '1', 0xFF, 0xFF, 0xFF, 0xFF, 0xFF});
  ASSERT_EQ(u.outcome(), Outcome::done);
  const auto& bytes = u.upload.result()->bytes;
  EXPECT_EQ(std::string(bytes.begin(), bytes.end()), "Tiny Drv1");
  EXPECT_THAT(u.tick(1000), IsEmpty());
}

TEST(SdoUpload, ARepeatedSegmentIsGarbledAndNotReadTwice) {
  Upload u;
  u.tick(0);
  u.answer({0x41, 0x08, 0x10, 0, 9, 0, 0, 0});
  u.tick(1);
  u.answer({0x00, 1, 2, 3, 4, 5, 6, 7});
  u.tick(2);
  u.answer({0x00, 1, 2, 3, 4, 5, 6, 7});
  EXPECT_EQ(u.outcome(), Outcome::garbled);
  EXPECT_THAT(u.tick(3), IsEmpty()) << "not even an abort is sent";
}

TEST(SdoUpload, AServerThatNeverEndsIsGivenUp) {
  Upload u;
  u.tick(0);
  u.answer({0x40, 0x08, 0x10, 0, 0, 0, 0, 0});
  int segments = 0;
  for (bool toggle = false; !u.upload.result() && segments < 1000; toggle = !toggle, ++segments) {
    u.tick(segments);
    u.answer({static_cast<std::uint8_t>(toggle ? 0x10 : 0x00), 1, 2, 3, 4, 5, 6, 7});
  }
  EXPECT_EQ(u.outcome(), Outcome::garbled);
  EXPECT_EQ(segments, 147);  // the first beyond 1024 bytes
}

TEST(SdoUpload, IsRepeatedOnceAndThenGivenUp) {
  Upload u;
  EXPECT_EQ(u.tick(0).size(), 1U);
  EXPECT_THAT(u.tick(99), IsEmpty());
  EXPECT_EQ(u.tick(100), std::vector{kRequest});
  EXPECT_THAT(u.tick(199), IsEmpty());
  EXPECT_FALSE(u.upload.result());
  EXPECT_THAT(u.tick(200), IsEmpty());
  EXPECT_EQ(u.outcome(), Outcome::no_answer);
}

TEST(SdoUpload, ALostSegmentEndsIt) {
  Upload u;
  u.tick(0);
  u.answer({0x41, 0x08, 0x10, 0, 9, 0, 0, 0});
  u.tick(1);
  EXPECT_THAT(u.tick(100), IsEmpty());
  EXPECT_FALSE(u.upload.result());
  EXPECT_THAT(u.tick(101), IsEmpty());
  EXPECT_EQ(u.outcome(), Outcome::no_answer);
}

TEST(SdoUpload, TellsTheAbortCode) {
  Upload u;
  u.tick(0);
  u.answer({0x80, 0x08, 0x10, 0, 0x00, 0x00, 0x02, 0x06});
  ASSERT_EQ(u.outcome(), Outcome::aborted);
  EXPECT_EQ(u.upload.result()->abort_code, 0x06020000U);
}

TEST(SdoUpload, AnswersToOthersChangeNothing) {
  Upload u;
  u.answer({0x43, 0x08, 0x10, 0, 1, 2, 3, 4});  // before it has asked
  u.tick(0);
  u.answer({0x43, 0x09, 0x10, 0, 1, 2, 3, 4});  // another index
  u.answer({0x43, 0x08, 0x10, 1, 1, 2, 3, 4});  // another subindex
  u.answer({0x80, 0x08, 0x10, 1, 0, 0, 2, 6});
  u.answer({0x60, 0x08, 0x10, 0, 0, 0, 0, 0});  // to a write
  u.answer({0x43, 0x08, 0x10, 0, 1, 2, 3});     // seven bytes
  u.upload.on_frame(CanFrame::make(0x586, {0x43, 0x08, 0x10, 0, 1, 2, 3, 4}));
  EXPECT_FALSE(u.upload.result());
}

TEST(SdoUpload, OnlyUploadRequestsCountAsReading) {
  EXPECT_TRUE(is_upload_request(kRequest));
  EXPECT_TRUE(is_upload_request(CanFrame::make(0x67F, {0x70, 0, 0, 0, 0, 0, 0, 0})));
  for (const std::uint8_t command : {0x00, 0x20, 0x21, 0x23, 0x2B, 0x2F, 0x41, 0x50, 0x80, 0xA0}) {
    EXPECT_FALSE(is_upload_request(CanFrame::make(0x605, {command, 0, 0, 0, 0, 0, 0, 0})));
  }
  for (const std::uint32_t id : {0x000U, 0x080U, 0x205U, 0x585U, 0x600U, 0x680U, 0x77FU}) {
    EXPECT_FALSE(is_upload_request(CanFrame::make(id, {0x40, 0, 0, 0, 0, 0, 0, 0})));
  }
  EXPECT_FALSE(is_upload_request(CanFrame::make(0x605, {0x40, 0x08, 0x10, 0})));
  CanFrame remote = kRequest;
  remote.remote = true;
  EXPECT_FALSE(is_upload_request(remote));
}

}  // namespace
}  // namespace tether
