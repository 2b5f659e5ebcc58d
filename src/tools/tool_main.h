#pragma once

#include <fcntl.h>
#include <unistd.h>

#include <cstdio>
#include <exception>
#include <filesystem>
#include <iostream>
#include <new>
#include <string>
#include <system_error>
#include <vector>

#include <CLI/CLI.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/common/option.h"

namespace acmp {

constexpr int kExitDone = 0;
constexpr int kExitFailed = 1;    ///< correct input that could not be processed
constexpr int kExitBadInput = 2;  ///< wrong use or input

/// A standard stream that is closed would leave its number to the next file, and what is printed would go into that.
/// In its place a device that takes nothing, so that Printed fails.
inline void KeepStandardStreams() {
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) {
    if (fcntl(stream, F_GETFD) >= 0) continue;
    if (open(stream == STDIN_FILENO ? "/dev/null" : "/dev/full", O_RDWR) < 0) break;  // what is left stays closed
  }
}

/// The exit code of a program whose result is what it printed: throws ProcessingError where that did not get out, as on
/// a full disk.
inline int Printed() {
  if (std::cout.flush() && std::fflush(stdout) == 0) return kExitDone;
  throw ProcessingError("cannot write to the standard output: what was printed is lost");
}

/// What the system's words for a thread that cannot be started leave out; empty for other errors.
inline std::string ThreadLimitReason(const std::exception& error) {
  const auto* of_system = dynamic_cast<const std::system_error*>(&error);
  if (!of_system || of_system->code() != std::errc::resource_unavailable_try_again) return "";
  return ": no further thread can be started; memory or the number of processes is limited (ulimit -v, -u)";
}

/// Declares an option of a table on the command line, under the table's heading.
inline CLI::Option* AddOption(const Option& option, CLI::App* app) {
  const OptionValue value = option.get();
  if (!option.group.empty()) app->option_defaults()->group(option.group);
  if (value == OptionValue(false)) {
    return app->add_flag_callback(
        option.name, [option] { option.set(true); }, option.sentence);
  }
  const std::string values = DescribeValues(option);
  CLI::Option* added = app->add_option_function<std::string>(
      option.name, [option](const std::string& text) { option.set(ParseOption(option, text)); },
      values.empty() ? option.sentence : Concat(option.sentence, " (", values, ")"));
  return value == OptionValue(std::string()) ? added : added->type_name("")->default_str(ToYaml(value));
}

/// Parses the command line and runs `body()`, which returns an exit code; errors become one line on stderr and the code
/// that belongs to them.
template <class Body>
int RunTool(CLI::App& app, int argc, char** argv, const Body& body) {
  KeepStandardStreams();
  try {
    app.set_version_flag("--version", ACMP_VERSION);
    app.parse(argc, argv);
    return body();
  } catch (const CLI::ParseError& error) {
    // Rather what is there and unknown, a misspelt option for one, than what is missing or, as its value, too much.
    const std::string name = error.get_name();
    const std::vector<std::string> unknown = app.remaining(true);
    if (!unknown.empty() && (name == "RequiredError" || name == "ArgumentMismatch")) {
      app.exit(CLI::ExtrasError(unknown));
      return kExitBadInput;
    }
    if (app.exit(error) != 0) return kExitBadInput;
    try {
      return Printed();  // --help is a ParseError with code 0
    } catch (const ProcessingError& lost) {
      std::cerr << app.get_name() << ": " << lost.what() << '\n';
      return kExitFailed;
    }
  } catch (const InvalidInputError& error) {
    std::cerr << app.get_name() << ": " << error.what() << '\n';
    return kExitBadInput;
  } catch (const std::bad_alloc&) {
    std::cerr << app.get_name() << ": there is not enough memory\n";
    return kExitFailed;
  } catch (const std::filesystem::filesystem_error& error) {
    std::cerr << app.get_name() << ": " << error.path1().string() << ": " << error.code().message() << '\n';
    const bool is_bad_name =
        error.code() == std::errc::filename_too_long || error.code() == std::errc::too_many_symbolic_link_levels;
    return is_bad_name ? kExitBadInput : kExitFailed;
  } catch (const std::exception& error) {
    std::cerr << app.get_name() << ": " << error.what() << ThreadLimitReason(error) << '\n';
    return kExitFailed;
  }
}

}  // namespace acmp
