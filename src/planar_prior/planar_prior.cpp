#include "acmp_mapping/planar_prior/planar_prior.h"
