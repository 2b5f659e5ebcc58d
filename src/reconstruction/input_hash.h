#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "acmp_mapping/common/stop_request.h"
#include "acmp_mapping/dataset/scene.h"

namespace acmp {

/// Of the content of an image's files: itself, its mask, its prior depth. Reads them, without decoding.
uint64_t HashOfFiles(const SceneImage& image);

/// HashOfFiles of each of these images, side by side. Throws Interrupted.
/// @param also is called for each, in any thread
std::vector<uint64_t> HashFiles(const Scene& scene, const std::vector<int>& indices, const StopRequest& interrupt,
                                const std::function<void(int index)>& also);

/// Another number once one of these files has been written or replaced. Does not read them.
uint64_t StampOfFiles(const SceneImage& image);

/// Of all that a run reads: files, cameras, poses, landmarks, ranges and source views that the dataset names.
/// @param files HashOfFiles of the image at the same place of `indices`
/// @return 16 digits
std::string InputHash(const Scene& scene, const std::vector<int>& indices, const std::vector<uint64_t>& files);

}  // namespace acmp
