// Writes what lists the options for people and for dynamic_reconfigure, from the tables that the programs read them by.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <boost/algorithm/string/replace.hpp>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/ros/options.h"
#include "acmp_mapping/ros/topic_names.h"
#include "tool_main.h"

namespace acmp {
namespace {

constexpr char kSetByPreset[] = "pipeline";  ///< group of options
constexpr char kLaunch[] = "launch/dense_mapper.launch";

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

- Each is an argument of the launch files (`roslaunch --ros-args acmp_mapping dense_mapper.launch` lists them; `memory_limit` and
  `label_file` go to both nodes), or set them by a file of your own, `frontend_config:=` that of `dense_mapper`, `map_config:=` that of
  `map_server`.
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

std::string EscapedXml(std::string text) {
  boost::algorithm::replace_all(text, "&", "&amp;");
  boost::algorithm::replace_all(text, "<", "&lt;");
  boost::algorithm::replace_all(text, "\"", "&quot;");
  return text;
}

/// The launch file with its parts between two marks written anew: arguments, and what hands them on. Those that the
/// rest of the file declares are not declared twice.
std::string Launch(const std::string& text) {
  const std::string begin = "written by acmp_options -->\n", end = "<!-- end of what acmp_options writes -->";
  std::string kept[3];
  size_t from = 0;
  for (std::string& part : kept) {
    const size_t mark = text.find(begin, from), next = mark == std::string::npos ? mark : mark + begin.size();
    part = text.substr(from, next == std::string::npos ? next : next - from);
    from = next == std::string::npos ? text.size() : text.rfind('\n', text.find(end, next)) + 1;
  }
  std::ostringstream arguments, values;
  std::set<std::string> declared;
  const auto declare = [&](const std::string& name, const std::string& value, const std::string& doc) {
    const std::string argument = "  <arg name=\"" + name + "\"";
    const bool by_hand = std::any_of(std::begin(kept), std::end(kept),
                                     [&](const auto& part) { return part.find(argument) != std::string::npos; });
    if (by_hand || !declared.insert(name).second) return;
    arguments << argument << " default=\"" << value << "\" doc=\"" << EscapedXml(doc) << "\"/>\n";
  };
  for (const PoseInput& pose : PoseInputs()) {
    declare(pose.name, names::kDefaultTopics + pose.name, pose.type + " (pose_source: " + pose.name + ")");
    values << "    <remap from=\"" << pose.name << "\" to=\"$(arg " << pose.name << ")\"/>\n";
  }
  for (const auto& [node, options] : {std::pair("dense_mapper", MapperOptions()), {"map_server", MapServerList()}}) {
    for (const Option& option : options) {
      const std::string& name = option.name;
      declare(name, "config", option.sentence + Remark(option));
      const bool is_list = std::holds_alternative<std::vector<double>>(option.get());
      values << "    <" << (is_list ? "rosparam" : "param") << " if=\"$(eval " << name << " not in ('', 'config'))\" "
             << (is_list ? "param" : "name") << "=\"" << node << "/" << name << "\" "
             << (is_list ? "subst_value=\"true\">$(arg " + name + ")</rosparam>" : "value=\"$(arg " + name + ")\"/>")
             << "\n";
    }
  }
  return kept[0] + arguments.str() + kept[1] + values.str() + kept[2];
}

void Run(const std::filesystem::path& source, bool check) {
  const std::pair<const char*, std::string> files[] = {{"config/acmp_mapping.yaml", MapperYaml()},
                                                       {"config/map_server.yaml", MapServerYaml()},
                                                       {"config/DenseMapper.cfg", Cfg()},
                                                       {"docs/parameters.md", Markdown()},
                                                       {kLaunch, Launch(ReadFile(source / kLaunch))}};
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
      "Writes config/acmp_mapping.yaml, config/map_server.yaml, config/DenseMapper.cfg, docs/parameters.md and the "
      "arguments of launch/dense_mapper.launch from the tables of options in the sources.",
      "acmp_options");
  app.add_option("SOURCE", source, "Folder of the sources")->required()->check(CLI::ExistingDirectory);
  app.add_flag("--check", check, "Write nothing; fail when a file is not what would be written");
  return acmp::RunTool(app, argc, argv, [&] {
    acmp::Run(source, check);
    return acmp::Printed();
  });
}
