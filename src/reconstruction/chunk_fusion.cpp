#include "chunk_fusion.h"

#include <algorithm>
#include <cstring>
#include <memory>
#include <set>
#include <string>
#include <type_traits>

#include "acmp_mapping/common/error.h"
#include "view_outputs.h"
#include "work_blocks.h"

namespace acmp {
namespace {

static_assert(std::is_trivially_copyable_v<SurfacePoint>, "files have points as they are in memory");

std::filesystem::path PointsFile(const OutputFolder& folder, int index) { return folder.WorkFile("points", index); }
std::filesystem::path UsedFile(const OutputFolder& folder, int chunk) { return folder.WorkFile("used", chunk); }

/// A frame in the file of used pixels: this, and then a bit per pixel, row by row.
struct UsedHeader {
  int32_t index = 0;   ///< in the scene
  int32_t width = 0;   ///< px
  int32_t height = 0;  ///< px
  size_t bytes() const { return (static_cast<size_t>(width) * height + 7) / 8; }
};

void Append(int index, const Image<unsigned char>& used, std::string* content) {
  const UsedHeader header = {index, used.width(), used.height()};
  content->append(reinterpret_cast<const char*>(&header), sizeof(header));
  std::string bits(header.bytes(), '\0');
  for (size_t i = 0; i < used.size(); ++i) {
    if (used.data()[i] != 0) bits[i / 8] = static_cast<char>(bits[i / 8] | (1 << i % 8));
  }
  *content += bits;
}

/// The used pixels of a frame in a file's content; empty if it is not in there.
Image<unsigned char> Find(int index, const std::string& content) {
  for (size_t at = 0; at + sizeof(UsedHeader) <= content.size();) {
    UsedHeader header;
    std::memcpy(&header, &content[at], sizeof(header));
    at += sizeof(header);
    if (header.index == index) {
      Image<unsigned char> used(header.width, header.height);
      for (size_t i = 0; i < used.size(); ++i) {
        used.data()[i] = static_cast<unsigned char>(content[at + i / 8] >> i % 8 & 1);
      }
      return used;
    }
    at += header.bytes();
  }
  return {};
}

void TakeOverUsedPixels(ReconstructRun* run, FrameStore* frames, const std::map<int, int>& fused_before,
                        FusionEngine* engine, FusionStamps* stamps) {
  std::map<int, std::vector<int>> frames_of;  // by chunk
  for (const auto& [index, chunk] : fused_before) frames_of[chunk].push_back(index);
  for (const auto& [chunk, indices] : frames_of) {
    const std::optional<std::string> content = ReadBlock(UsedFile(run->folder, chunk));
    for (int index : indices) {
      const Image<unsigned char> used = content ? Find(index, *content) : Image<unsigned char>();
      if (used.empty()) {
        throw ProcessingError(Concat("--stage fuse: the stage of the images from ", chunk * run->options.chunk_images,
                                     " on is not done, or ", UsedFile(run->folder, chunk).string(), " is damaged"));
      }
      engine->SetUsedPixels(*frames->Get(index), used, stamps);
    }
  }
}

void WritePoints(const OutputFolder& folder, int index, const PointCloud& cloud) {
  WriteBlock(PointsFile(folder, index),
             {reinterpret_cast<const char*>(cloud.data()), cloud.size() * sizeof(SurfacePoint)});
}

}  // namespace

void FuseChunk(ReconstructRun* run, FrameStore* frames, int chunk, const std::vector<int>& images,
               const std::map<int, int>& fused_before) {
  const DeviceEngine engine = run->devices.Engine(0, 0);
  const FusionOptions options = MakePipelineOptions(run->options).fusion;
  const std::unique_ptr<FusionStamps> stamps = engine.engine->MakeFusionStamps();
  TakeOverUsedPixels(run, frames, fused_before, engine.engine, stamps.get());
  std::set<int> read;
  int rank = 0;  // that of all earlier chunks
  for (const ImagePlan& image : run->plan.images) {
    if (!std::binary_search(images.begin(), images.end(), image.index)) continue;
    const EngineProblem problem =
        InLocalCoordinates(run->store.Problem(image, run->store.final_step(), engine), run->plan.origin);
    run->interrupt.Check();
    WritePoints(run->folder, image.index,
                engine.engine->FuseView(problem.reference, problem.sources, options, ++rank, stamps.get()));
    for (int index : run->plan.ImagesRead(image)) read.insert(index);
    run->progress.Step();
  }
  std::string used;
  for (int index : read) Append(index, engine.engine->UsedPixels(*frames->Get(index), stamps.get()), &used);
  run->interrupt.Check();
  WriteBlock(UsedFile(run->folder, chunk), used);
}

bool HasChunkPoints(const OutputFolder& folder, int chunk, const std::vector<int>& images) {
  return ReadBlock(UsedFile(folder, chunk)).has_value() &&
         std::all_of(images.begin(), images.end(), [&](int i) { return ReadPointsOfView(folder, i).has_value(); });
}

std::optional<PointCloud> ReadPointsOfView(const OutputFolder& folder, int index) {
  const std::optional<std::string> content = ReadBlock(PointsFile(folder, index));
  if (!content || content->size() % sizeof(SurfacePoint) != 0) return std::nullopt;
  PointCloud cloud(content->size() / sizeof(SurfacePoint));
  if (!cloud.empty()) std::memcpy(static_cast<void*>(cloud.data()), content->data(), content->size());
  return cloud;
}

}  // namespace acmp
