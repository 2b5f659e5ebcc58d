#pragma once

#include <string>

#include "acmp_mapping/reconstruction/reconstruct_options.h"
#include "output_folder.h"

namespace acmp {

constexpr const char* kInputKey = "input (hash of images, masks, prior depth, cameras, poses, landmarks)";
constexpr const char* kDeviceKey = "device";

/// The options that decide the bits of the results, and which files there are.
RunRecord SettingsRecord(const ReconstructOptions& options);

/// Everything that does: the same with the input and the device.
RunRecord MakeRecord(const ReconstructOptions& options, const std::string& device, const std::string& input_hash);

/// "NVIDIA H200 (cuda:0)" -> "NVIDIA H200": what decides the bits.
std::string DeviceModel(const std::string& device_name);

}  // namespace acmp
