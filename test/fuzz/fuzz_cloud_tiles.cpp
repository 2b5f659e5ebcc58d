// The index of a cloud in tiles, beside one tile.

#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/evaluation/cloud_metrics.h"
#include "fuzz/fuzz_input.h"

ACMP_FUZZ_TARGET(cloud_tiles) {
  static const acmp::fuzz::Folder folder;
  acmp::WritePly(folder.path() / "0_0_0.ply", acmp::PointCloud(2));
  folder.Write("index.json", acmp::fuzz::Bytes(data, size).Rest());
  acmp::fuzz::MayRefuse([&] { acmp::ReadTiledCloud(folder.path()); });
  return 0;
}
