// Writes what lists the options for people and for dynamic_reconfigure, from the tables that the programs read them by.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/pipeline/parameters.h"
#include "acmp_mapping/ros/map_server_options.h"
#include "acmp_mapping/ros/node_options.h"
#include "acmp_mapping/ros/runtime_options.h"
#include "tool_main.h"

namespace acmp {
namespace {

struct Line {
  OptionDescription description;
  OptionValue default_value;
  bool from_preset = false;
};
using Lines = std::vector<Line>;

template <class Options>
void Append(const OptionTable<Options>& table, const Options& defaults, Lines* lines) {
  for (const Option<Options>& option : table) lines->push_back({option.description, option.get(defaults)});
}

Lines MapperLines() {
  Lines lines;
  const NodeOptions node;
  Append(NodeOptionTable(), node, &lines);
  RuntimeOptions runtime;
  runtime.mapper.pipeline = MakePreset(node.preset);
  Append(RuntimeOptionTable(), runtime, &lines);
  for (Line& line : lines) {
    for (const auto& option : PipelineOptionTable()) line.from_preset |= option.name() == line.description.name;
  }
  return lines;
}

Lines MapServerLines() {
  Lines lines;
  Append(MapServerOptionTable(), MapServerOptions(), &lines);
  return lines;
}

std::vector<std::string> Groups(const Lines& lines) {
  std::vector<std::string> groups;
  for (const Line& line : lines) {
    const std::string& group = line.description.group;
    if (std::find(groups.begin(), groups.end(), group) == groups.end()) groups.push_back(group);
  }
  return groups;
}

/// Runs write(line) for the lines of each group, after write_heading(group).
template <class WriteHeading, class WriteLine>
void ForEachGroup(const Lines& lines, const WriteHeading& write_heading, const WriteLine& write_line) {
  for (const std::string& group : Groups(lines)) {
    write_heading(group);
    for (const Line& line : lines) {
      if (line.description.group == group) write_line(line);
    }
  }
}

std::string Capitalized(std::string text) {
  text[0] = static_cast<char>(std::toupper(text[0]));
  return text;
}

/// "0 to 10 s; live", for yaml.
std::string Remark(const Line& line) {
  const bool flag = std::holds_alternative<bool>(line.default_value);
  std::string remark = flag ? "" : DescribeValues(line.description, line.default_value);
  if (line.description.while_running) remark += remark.empty() ? "live" : "; live";
  return remark.empty() ? "" : " [" + remark + "]";
}

void WriteYamlLines(const Lines& lines, std::ostream* out) {
  ForEachGroup(
      lines, [out](const std::string& group) { *out << "\n# --- " << group << " ---\n"; },
      [out](const Line& line) {
        *out << "# " << line.description.sentence << Remark(line) << "\n"
             << (line.from_preset ? "#" : "") << line.description.name << ": " << ToYaml(line.default_value) << "\n";
      });
}

std::string MapperYaml() {
  std::ostringstream out;
  out << R"(# All parameters of the dense mapper with their defaults; written by acmp_options, as docs/parameters.md. Copy what you
# change into your own file or launch file: leaving a line out means the default. Lengths are in the unit of the poses
# (metres for most frontends). [live]: may change while it runs, by dynamic_reconfigure.
)";
  const Lines lines = MapperLines();
  Lines fixed, from_preset;
  for (const Line& line : lines) (line.from_preset ? from_preset : fixed).push_back(line);
  WriteYamlLines(fixed, &out);
  out << "\n# The following are set by the preset, here with the values of the default one. Without the # before its "
         "name a\n"
         "# line counts more than the preset.\n";
  WriteYamlLines(from_preset, &out);
  return out.str();
}

std::string MapServerYaml() {
  std::ostringstream out;
  out << "# All parameters of the map server with their defaults; written by acmp_options, as docs/parameters.md.\n";
  WriteYamlLines(MapServerLines(), &out);
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
  Lines lines = MapperLines();
  lines.erase(std::remove_if(lines.begin(), lines.end(), [](const Line& l) { return !l.description.while_running; }),
              lines.end());
  ForEachGroup(
      lines, [&out](const std::string& group) { out << "\ngroup = gen.add_group(\"" << group << "\")\n"; },
      [&out](const Line& line) {
        const OptionValue& value = line.default_value;
        const bool flag = std::holds_alternative<bool>(value);
        std::string text = ToYaml(value);
        if (flag) text = Capitalized(text);
        out << "group.add(\"" << line.description.name << "\", "
            << (flag ? "bool_t" : (std::holds_alternative<int>(value) ? "int_t" : "double_t")) << ", 0,\n          \""
            << line.description.sentence << "\", " << text << ")\n";
      });
  out << "\nexit(gen.generate(\"acmp_mapping\", \"dense_mapper\", \"DenseMapper\"))\n";
  return out.str();
}

void WriteTables(const Lines& lines, std::ostream* out) {
  ForEachGroup(
      lines,
      [out](const std::string& group) {
        *out << "\n### " << Capitalized(group) << "\n\n| parameter | default | values | |\n|---|---|---|---|\n";
      },
      [out](const Line& line) {
        *out << "| `" << line.description.name << "`" << (line.description.while_running ? " *" : "") << " | `"
             << ToYaml(line.default_value) << "` | " << DescribeValues(line.description, line.default_value) << " | "
             << line.description.sentence << " |\n";
      });
}

void WritePresetTable(std::ostream* out) {
  *out << "\n## What each preset sets\n\n| option |";
  for (const std::string& name : PresetNames()) *out << " `" << name << "` |";
  *out << "\n|---|";
  for (size_t i = 0; i < PresetNames().size(); ++i) *out << "---|";
  *out << "\n";
  for (const auto& option : PipelineOptionTable()) {
    *out << "| `" << option.name() << "` |";
    for (const std::string& name : PresetNames()) *out << " " << ToYaml(option.get(MakePreset(name))) << " |";
    *out << "\n";
  }
}

std::string Markdown() {
  std::ostringstream out;
  out << R"(# Parameters

Written by `acmp_options` from the tables in the sources: change a parameter there. Names marked * may change while the
mapper runs (`rosrun dynamic_reconfigure dynparam set /acmp/dense_mapper NAME VALUE`); all others are read once, when a
node starts. A value that is out of bounds, or does not fit another one, is refused with a message. A parameter that a node
does not know is named in a warning.

## dense_mapper

Private parameters, in [config/acmp_mapping.yaml](../config/acmp_mapping.yaml). Those of the last group are set by `preset`;
one that is given counts more.
)";
  WriteTables(MapperLines(), &out);
  out << "\n## map_server\n\nPrivate parameters, in [config/map_server.yaml](../config/map_server.yaml).\n";
  WriteTables(MapServerLines(), &out);
  out << R"(
## acmp_reconstruct and acmp_benchmark

`--set NAME=VALUE` sets an option of the pipeline over the preset's: all of the group "pipeline" above, and:
)";
  Lines offline;
  for (const auto& option : PipelineOptionTable()) {
    if (!option.description.while_running)
      offline.push_back({option.description, option.get(MakePreset(NodeOptions().preset))});
  }
  WriteTables(offline, &out);
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
