// Writes what lists the options for people and for dynamic_reconfigure, from the tables that the programs read them by.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/ros/options.h"
#include "tool_main.h"

namespace acmp {
namespace {

constexpr char kSetByPreset[] = "pipeline";  ///< group of options

/// All options of the mapper, or of the map server, with their defaults. They refer to objects that stay.
OptionList MapperOptions() {
  static NodeOptions node;
  static RuntimeOptions runtime;
  runtime.mapper.pipeline = MakePreset(kUsualPreset);
  OptionList options = OptionsOf(&node);
  options.Append(OptionsOf(&runtime));
  return options;
}

OptionList MapServerList() {
  static MapServerOptions options;
  return OptionsOf(&options);
}

/// Runs write(option) for the options of each group, after write_heading(group).
template <class WriteHeading, class WriteOption>
void ForEachGroup(const OptionList& options, const WriteHeading& write_heading, const WriteOption& write) {
  std::vector<std::string> groups;
  for (const Option& option : options) {
    if (std::find(groups.begin(), groups.end(), option.group) == groups.end()) groups.push_back(option.group);
  }
  for (const std::string& group : groups) {
    write_heading(group);
    for (const Option& option : options) {
      if (option.group == group) write(option);
    }
  }
}

std::string Capitalized(std::string text) {
  text[0] = static_cast<char>(std::toupper(text[0]));
  return text;
}

/// Lines of a comment in yaml, of 120 characters at most.
std::string Comment(const std::string& text) {
  constexpr size_t kColumns = 120;
  std::istringstream words(text);
  std::string lines, line = "#";
  for (std::string word; words >> word; line += " " + word) {
    if (line.size() + 1 + word.size() <= kColumns) continue;
    lines += line + "\n";
    line = "#";
  }
  return lines + line + "\n";
}

/// "0 to 10 s; live", for yaml.
std::string Remark(const Option& option) {
  std::string remark = std::holds_alternative<bool>(option.get()) ? "" : DescribeValues(option);
  if (option.while_running) remark += remark.empty() ? "live" : "; live";
  return remark.empty() ? "" : " [" + remark + "]";
}

void WriteYaml(const OptionList& options, std::ostream* out) {
  bool by_preset = false;
  ForEachGroup(
      options,
      [&](const std::string& group) {
        by_preset = group == kSetByPreset;
        if (by_preset) {
          *out << "\n# The following are set by the preset, here with the values of the default one. Without the # "
                  "before its name a\n# line counts more than the preset.\n";
        }
        *out << "\n# --- " << group << " ---\n";
      },
      [&](const Option& option) {
        *out << Comment(option.sentence + Remark(option)) << (by_preset ? "#" : "") << option.name << ": "
             << ToYaml(option.get()) << "\n";
      });
}

std::string MapperYaml() {
  std::ostringstream out;
  out << R"(# All parameters of the dense mapper with their defaults (docs/parameters.md); written by acmp_options. Copy what you
# change into your own file or launch file: leaving a line out means the default. Lengths are in the unit of the poses
# (metres for most frontends). [live]: may change while it runs, by dynamic_reconfigure.
)";
  WriteYaml(MapperOptions(), &out);
  return out.str();
}

std::string MapServerYaml() {
  std::ostringstream out;
  out << "# All parameters of the map server with their defaults (docs/parameters.md); written by acmp_options.\n";
  WriteYaml(MapServerList(), &out);
  return out.str();
}

std::string Cfg() {
  std::ostringstream out;
  out << R"(#!/usr/bin/env python3
"""Parameters of the dense mapper that may change while it runs; written by acmp_options. Bounds are not here: the server
would silently limit values to them, while the mapper refuses what is out of bounds and says so. It tells clients the
bounds when it starts."""
from dynamic_reconfigure.parameter_generator_catkin import ParameterGenerator, bool_t, double_t, int_t

gen = ParameterGenerator()
)";
  OptionList live;
  live.Append(MapperOptions(), true);
  ForEachGroup(
      live, [&out](const std::string& group) { out << "\ngroup = gen.add_group(\"" << group << "\")\n"; },
      [&out](const Option& option) {
        const OptionValue value = option.get();
        const bool flag = std::holds_alternative<bool>(value);
        out << "group.add(\"" << option.name << "\", "
            << (flag ? "bool_t" : (std::holds_alternative<int>(value) ? "int_t" : "double_t")) << ", 0,\n          \""
            << option.sentence << "\", " << (flag ? Capitalized(ToYaml(value)) : ToYaml(value)) << ")\n";
      });
  out << "\nexit(gen.generate(\"acmp_mapping\", \"dense_mapper\", \"DenseMapper\"))\n";
  return out.str();
}

void WritePresetTable(std::ostream* out) {
  *out << "\n## What each preset sets\n\n| option |";
  for (const std::string& name : PresetNames()) *out << " `" << name << "` |";
  *out << "\n|---|";
  for (size_t i = 0; i < PresetNames().size(); ++i) *out << "---|";
  *out << "\n";
  PipelineOptions pipeline;
  for (const Option& option : OptionsOf(&pipeline)) {
    *out << "| `" << option.name << "` |";
    for (const std::string& name : PresetNames()) {
      pipeline = MakePreset(name);
      *out << " " << ToYaml(option.get()) << " |";
    }
    *out << "\n";
  }
}

std::string Markdown() {
  std::ostringstream out;
  out << R"(# Parameters

Two files list all private parameters, each with what it does, its bounds and its default:
[config/acmp_mapping.yaml](../config/acmp_mapping.yaml) those of `dense_mapper`,
[config/map_server.yaml](../config/map_server.yaml) those of `map_server`. They and this page are written by `acmp_options` from the
tables in the sources: change a parameter there.

- Set them by arguments of the launch files (`roslaunch --ros-args acmp_mapping dense_mapper.launch` lists them), or by a file of
  your own, `frontend_config:=` that of `dense_mapper`, `map_config:=` that of `map_server`.
- Those marked `[live]` may change while the mapper runs (`rosrun dynamic_reconfigure dynparam set /acmp/dense_mapper NAME VALUE`);
  all others are read once, when a node starts.
- A value that is out of bounds, or does not fit another one, is refused with a message. A parameter that a node does not know is
  named in a warning.
- Those of the group "pipeline" are set by `preset`; one that is given counts more.

## acmp_reconstruct and acmp_benchmark

`--set NAME=VALUE` sets an option of the pipeline over the preset's: all of the group "pipeline", and:

| option | default | values | |
|---|---|---|---|
)";
  PipelineOptions pipeline = MakePreset(kUsualPreset);
  for (const Option& option : OptionsOf(&pipeline)) {
    if (option.while_running) continue;
    out << "| `" << option.name << "` | `" << ToYaml(option.get()) << "` | " << DescribeValues(option) << " | "
        << option.sentence << " |\n";
  }
  WritePresetTable(&out);
  return out.str();
}

std::string ReadFile(const std::filesystem::path& path) {
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

void Run(const std::filesystem::path& source, bool check) {
  const std::pair<const char*, std::string> files[] = {{"config/acmp_mapping.yaml", MapperYaml()},
                                                       {"config/map_server.yaml", MapServerYaml()},
                                                       {"config/DenseMapper.cfg", Cfg()},
                                                       {"docs/parameters.md", Markdown()}};
  for (const auto& [name, text] : files) {
    if (check) {
      if (ReadFile(source / name) == text) continue;
      throw InvalidInputError(
          Concat(name, " is not what the tables of options say: write it anew with acmp_options ", source.string()));
    }
    std::ofstream file(source / name, std::ios::binary);
    if (!(file << text << std::flush)) throw ProcessingError(Concat("cannot write ", (source / name).string()));
  }
}

}  // namespace
}  // namespace acmp

// NOLINTNEXTLINE(bugprone-exception-escape): only a wrong table of options or no memory throw outside RunTool
int main(int argc, char** argv) {
  std::string source;
  bool check = false;
  CLI::App app(
      "Writes config/acmp_mapping.yaml, config/map_server.yaml, config/DenseMapper.cfg and docs/parameters.md from the "
      "tables of options in the sources.",
      "acmp_options");
  app.add_option("SOURCE", source, "Folder of the sources")->required()->check(CLI::ExistingDirectory);
  app.add_flag("--check", check, "Write nothing; fail when a file is not what would be written");
  return acmp::RunTool(app, argc, argv, [&] {
    acmp::Run(source, check);
    return acmp::Printed();
  });
}
