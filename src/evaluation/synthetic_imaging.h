#pragma once

#include <cstdint>
#include <vector>

#include "acmp_mapping/evaluation/synthetic_scene.h"
#include "synthetic_camera.h"
#include "synthetic_texture.h"

namespace acmp {

/// Throws InvalidInputError naming the first field out of bounds.
void Validate(const ImagingModel& model);

/// Exposure of image `index`, as a factor.
double ExposureOf(const ImagingModel& model, uint32_t seed, int index);

/// The camera at `count` evenly spaced moments while the shutter is open; `pose` lies in their middle. The camera only
/// turns: at 0.2 m/s it moves 3 mm in 1/60 s, at 2.4 m a third of what a shake of 0.25 degrees moves the image.
std::vector<CameraPose> PosesDuringExposure(const ImagingModel& model, const CameraPose& pose, uint32_t seed, int index,
                                            int count);

/// Largest angle in radians between a pose during the exposure and the one in the middle.
double LargestTurn(const ImagingModel& model);

/// Pixels around the image that its blur reads.
int PsfBorder(const ImagingModel& model);

/// Blurs an image that has PsfBorder() more pixels on each side than the result. Repeated symmetric kernels of three
/// taps with the model's variance in all: close to a Gaussian, and exact without libm.
Image<ColorD> BlurByPsf(const ImagingModel& model, Image<ColorD> light);

/// Share of the light that reaches a pixel.
double VignettingAt(const ImagingModel& model, const PinholeCamera& camera, int col, int row);

/// Grey levels of one pixel whose noiseless signal is `signal`.
Rgb Digitize(const ImagingModel& model, const ColorD& signal, RandomStream* random);

}  // namespace acmp
