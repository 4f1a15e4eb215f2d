#include "netem/models/kinds.hpp"

#include "netem/stages/kinds.hpp"
#include "tests/support/table_rows.hpp"

namespace tether {
namespace {

TEST(ChannelModels, EachHasALineInTheTableAndWhatItMustHave) {
  test::expect_has_all_rows(channel_model_kinds(), "netem/models", "ChannelModelKind", "_model");
  for (const ChannelModelKind& kind : channel_model_kinds()) {
    EXPECT_TRUE(kind.make != nullptr && kind.moves != nullptr && kind.export_loss != nullptr)
        << kind.name;
    EXPECT_EQ(kind.expect == nullptr, !kind.why_open.empty()) << kind.name;
  }
}

TEST(LinkStages, EachHasALineInTheTableAndWhatItMustHave) {
  test::expect_has_all_rows(link_stage_kinds(), "netem/stages", "LinkStageKind", "_stage");
  for (const LinkStageKind& kind : link_stage_kinds()) {
    EXPECT_NE(kind.make, nullptr) << kind.name;
    EXPECT_EQ(kind.keys == nullptr, kind.name == "state") << kind.name;
  }
}

}  // namespace
}  // namespace tether
