#include "can_bridge/bus/canopen.hpp"

#include <gtest/gtest.h>

namespace tether::canopen {
namespace {

TEST(CanOpen, WritesTheExpeditedDownloadOfTheHeartbeatConsumerAsTheStandardShowsIt) {
  const CanFrame f = sdo_download(1, {0x1016, 1, 4, false}, 0x007F00FA);
  EXPECT_EQ(f, CanFrame::make(0x601, {0x23, 0x16, 0x10, 0x01, 0xFA, 0x00, 0x7F, 0x00}));
}

TEST(CanOpen, MarksUnusedBytesOfShortDownloads) {
  EXPECT_EQ(sdo_download(1, {0x6060, 0, 1, true}, 3),
            CanFrame::make(0x601, {0x2F, 0x60, 0x60, 0x00, 3, 0, 0, 0}));
  EXPECT_EQ(sdo_download(1, {0x1017, 0, 2, false}, 100),
            CanFrame::make(0x601, {0x2B, 0x17, 0x10, 0x00, 100, 0, 0, 0}));
}

TEST(CanOpen, ReadsSignedIntegersOfEachSize) {
  const std::uint8_t minus_two[] = {0xFE, 0xFF, 0xFF, 0xFF};
  EXPECT_EQ(read_integer(minus_two, 1, true), -2);
  EXPECT_EQ(read_integer(minus_two, 2, true), -2);
  EXPECT_EQ(read_integer(minus_two, 4, true), -2);
  EXPECT_EQ(read_integer(minus_two, 4, false), 0xFFFFFFFE);
}

TEST(CanOpen, TellsTheDriveStatesApart) {
  EXPECT_EQ(drive_state(0x0240), DriveState::switch_on_disabled);
  EXPECT_EQ(drive_state(0x0631), DriveState::ready_to_switch_on);
  EXPECT_EQ(drive_state(0x0633), DriveState::switched_on);
  EXPECT_EQ(drive_state(0x1637), DriveState::operation_enabled);
  EXPECT_EQ(drive_state(0x0617), DriveState::quick_stop_active);
  EXPECT_EQ(drive_state(0x021F), DriveState::fault_reaction);
  EXPECT_EQ(drive_state(0x0218), DriveState::fault);
  EXPECT_EQ(drive_state(0x0010), DriveState::not_ready);
  EXPECT_EQ(drive_state(0x0001), std::nullopt);
}

TEST(CanOpen, NamesAbortCodes) {
  EXPECT_EQ(abort_text(0x06020000), "0x06020000 (no such object)");
  EXPECT_EQ(abort_text(0x12345678), "0x12345678 (vendor's own)");
}

}  // namespace
}  // namespace tether::canopen
