#pragma once

namespace CLI {  // NOLINT(readability-identifier-naming)
class App;
}

namespace tether {

/// Examples at the end of the helps of those commands that `app` has, of all that `tether` has. A
/// command without any fails documents_test.
void add_command_examples(CLI::App& app);

}  // namespace tether
