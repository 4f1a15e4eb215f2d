#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace tether {

/// Runs a program (looked up in PATH) in `folder` and waits for it. Returns its exit code; 127 if
/// there is no such program; 128 + signal if a signal ended it.
int run_process(const std::vector<std::string>& command, const std::filesystem::path& folder);

/// Where `name` lies in PATH; empty if nowhere.
std::filesystem::path find_program(const std::string& name);

/// `command` as the null-terminated array that exec wants; valid as long as `command` is.
std::vector<char*> to_argv(const std::vector<std::string>& command);

}  // namespace tether
