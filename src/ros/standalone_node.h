#pragma once

namespace acmp {

/// Main function of a nodelet in a process of its own: runs until SIGINT or SIGTERM. Returns the exit code.
int RunStandalone(int argc, char** argv, const char* default_name, const char* nodelet_type);

}  // namespace acmp
