#pragma once

#include <map>
#include <set>
#include <string>

#include "acmp_mapping/fusion/point_cloud.h"
#include "acmp_mapping/image/label.h"
#include "acmp_mapping/image/mask.h"

namespace acmp {

/// What a label stands for.
struct LabelClass {
  std::string name;
  Rgb color;
  bool in_map = true;        ///< false: its pixels are ignored, as by a mask
  bool in_occupancy = true;  ///< false: it is no obstacle
};

/// The file of ~label_file.
class LabelTable {
 public:
  LabelTable() = default;
  /// Reads YAML, of each label "7: {name: grass, color: [0, 180, 0], map: true, occupancy: false}", of which only the
  /// name must be there. Throws InvalidInputError naming file, label and value.
  /// @param path empty: no class is known
  explicit LabelTable(const std::string& path);

  /// The classes that are not there: "12, 250; ~label_file PATH has 1 to 9". Empty where all are, or there is no file.
  std::string DescribeUnknown(const LabelImage& labels) const;
  /// Ignores the classes that do not go into the map; empty where none is among the pixels.
  Mask MaskOf(const LabelImage& labels) const;
  /// Labels of what is no obstacle.
  std::set<Label> PassableLabels() const;
  /// The points in their classes' colours; what has no class is grey.
  PointCloud Colored(PointCloud points) const;

 private:
  std::string path_;
  std::map<Label, LabelClass> classes_;
};

}  // namespace acmp
