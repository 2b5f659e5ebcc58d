#pragma once

#include <exception>
#include <iostream>

#include <CLI/CLI.hpp>

#include "acmp_mapping/common/error.h"

namespace acmp {

constexpr int kExitDone = 0;
constexpr int kExitFailed = 1;    ///< correct input that could not be processed
constexpr int kExitBadInput = 2;  ///< wrong use or input

/// Parses the command line and runs `body()`, which returns an exit code; errors become one line on stderr and the code
/// that belongs to them.
template <class Body>
int RunTool(CLI::App& app, int argc, char** argv, const Body& body) {
  try {
    app.set_version_flag("--version", ACMP_VERSION);
    app.parse(argc, argv);
    return body();
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? kExitDone : kExitBadInput;  // --help is a ParseError with code 0
  } catch (const InvalidInputError& error) {
    std::cerr << app.get_name() << ": " << error.what() << '\n';
    return kExitBadInput;
  } catch (const std::exception& error) {
    std::cerr << app.get_name() << ": " << error.what() << '\n';
    return kExitFailed;
  }
}

}  // namespace acmp
