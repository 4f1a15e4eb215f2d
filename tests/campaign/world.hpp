#pragma once

#include "tests/campaign/setup.hpp"

namespace tether::campaign {

/// Runs a trial in virtual time, in the calling thread. With `notes`, the record tells the story.
Record run_trial(const Setup& setup, const Trial& trial, bool notes);

}  // namespace tether::campaign
