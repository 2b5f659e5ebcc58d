#include "acmp_mapping/ros/label_file.h"

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

#include <yaml-cpp/yaml.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/ros/input_conversion.h"

namespace acmp {
namespace {

/// As PASCAL VOC colours its classes: from the lowest bit of the number on three by three, one each of red, green,
/// blue.
Rgb UsualColor(unsigned label) {
  Rgb color = {0, 0, 0};
  for (unsigned bit = 128; label != 0; label >>= 3, bit /= 2) {
    color.r = static_cast<unsigned char>(color.r | ((label & 1) != 0 ? bit : 0));
    color.g = static_cast<unsigned char>(color.g | ((label & 2) != 0 ? bit : 0));
    color.b = static_cast<unsigned char>(color.b | ((label & 4) != 0 ? bit : 0));
  }
  return color;
}

Rgb ReadColor(const YAML::Node& node) {
  const auto numbers = node.as<std::vector<int>>();
  const auto fits = [](int number) { return number >= 0 && number <= 255; };
  if (numbers.size() == 3 && std::all_of(numbers.begin(), numbers.end(), fits)) {
    const auto byte = [&](size_t i) { return static_cast<unsigned char>(numbers[i]); };
    return {byte(0), byte(1), byte(2)};
  }
  throw InvalidInputError("color: must be three numbers from 0 to 255");
}

LabelClass ReadClass(int label, const YAML::Node& node) {
  LabelClass read = {"", UsualColor(static_cast<unsigned>(label))};
  if (!node.IsMap()) throw InvalidInputError("must be a map with name and, if need be, color, map and occupancy");
  for (const auto& member : node) {
    const YAML::Node &key = member.first, &value = member.second;
    const auto name = key.as<std::string>();
    if (name == "name") {
      read.name = value.as<std::string>();
    } else if (name == "color") {
      read.color = ReadColor(value);
    } else if (name == "map") {
      read.in_map = value.as<bool>();
    } else if (name == "occupancy") {
      read.in_occupancy = value.as<bool>();
    } else {
      throw InvalidInputError(Concat(name, ": must be one of name, color, map, occupancy"));
    }
  }
  if (read.name.empty()) throw InvalidInputError("name is missing");
  return read;
}

}  // namespace

LabelTable::LabelTable(const std::string& path) : path_(path) {
  if (path.empty()) return;
  ReadSmallFile("label_file", path, [&] {
    const YAML::Node file = YAML::LoadFile(path);
    if (!file.IsMap() || file.size() == 0) throw InvalidInputError("must be a map from labels to classes");
    for (const auto& member : file) {
      const YAML::Node &key = member.first, &value = member.second;
      try {
        const int label = key.as<int>();
        CheckRange("label", label, 1, kMaxLabel);
        if (!classes_.emplace(static_cast<Label>(label), ReadClass(label, value)).second) {
          throw InvalidInputError("comes twice");
        }
      } catch (const std::exception& error) {
        throw InvalidInputError(Concat("label ", key.Scalar(), ": ", error.what()));
      }
    }
  });
}

std::string LabelTable::DescribeUnknown(const LabelImage& labels) const {
  if (classes_.empty()) return "";
  std::array<bool, kMaxLabel + 1> is_there = {};
  for (const Label label : labels) is_there[label] = true;
  std::string unknown;
  for (int label = 1; label <= kMaxLabel; ++label) {
    if (!is_there[static_cast<size_t>(label)] || classes_.count(static_cast<Label>(label)) > 0) continue;
    unknown += Concat(unknown.empty() ? "" : ", ", label);
  }
  if (unknown.empty()) return "";
  return Concat(unknown, "; ~label_file ", path_, " has ", classes_.size(), " classes from ",
                int{classes_.begin()->first}, " to ", int{classes_.rbegin()->first});
}

Mask LabelTable::MaskOf(const LabelImage& labels) const {
  std::array<unsigned char, kMaxLabel + 1> used;
  used.fill(255);
  for (const auto& [label, named] : classes_) used[label] = named.in_map ? 255 : 0;
  Mask mask(labels.width(), labels.height());
  std::transform(labels.begin(), labels.end(), mask.begin(), [&](Label label) { return used[label]; });
  return IgnoresSome(mask) ? std::move(mask) : Mask();
}

std::set<Label> LabelTable::PassableLabels() const {
  std::set<Label> labels;
  for (const auto& [label, named] : classes_) {
    if (!named.in_occupancy) labels.insert(label);
  }
  return labels;
}

PointCloud LabelTable::Colored(PointCloud points) const {
  std::array<Rgb, kMaxLabel + 1> colors;
  for (unsigned label = 0; label <= kMaxLabel; ++label) colors[label] = UsualColor(label);
  constexpr unsigned char kGrey = 90;
  colors[0] = {kGrey, kGrey, kGrey};
  for (const auto& [label, named] : classes_) colors[label] = named.color;
  for (SurfacePoint& point : points) point.color = colors[point.label];
  return points;
}

}  // namespace acmp
